"""What sixteen rays see of balls, and of the probe in their mirrors; and pixels as they lie in memory."""

from __future__ import annotations

import numpy as np

from engines.dahlquist.animation import REAL
from engines.dahlquist.frame import SPHERE
from engines.dahlquist.numba_rays import HALF, ZERO, BallRow, BoxRow, unit
from engines.dahlquist.numpy_frame import TO_LIGHT
from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import LANES, Row, Table, array, real, rows, scalar, table_view
from engines.kernels.compile.values import select
from engines.kernels.lane.vector import Vec3, dot

TWO, FOUR, MOST = (REAL(x) for x in (2, 4, 255))
TO_LIGHT_X, TO_LIGHT_Y, TO_LIGHT_Z = (REAL(x) for x in TO_LIGHT[:, 0])
LOW_BYTE = np.uint32(255)


class StretchRow(Row):
    """Texels left and right of a column of pixels, and the right one's weight."""

    dtype = REAL
    left = real()
    right = real()
    share = real()


class FrameTable(Table):
    """What all threads read."""

    balls = rows(BallRow)
    boxes = rows(BoxRow)
    probe = array(np.uint32)
    probe_width = scalar()
    probe_height = scalar()
    background = array(REAL)
    background_width = scalar()
    background_height = scalar()
    stretch = rows(StretchRow)


frame_table = table_view(FrameTable)


@inline
def reflect(rays, balls):
    """Shades the ball that each lane has met, and turns the lane's ray into the mirrored one."""
    for lane in range(np.uint64(LANES)):
        origin, distance = rays.origin[lane], rays.distance[lane]
        ball = balls[rays.ball[lane]]
        center = ball.center
        towards = unit(rays.direction[lane])
        normal = unit(origin + towards * distance - center)
        cosine = TO_LIGHT_X * normal.x + TO_LIGHT_Y * normal.y + TO_LIGHT_Z * normal.z
        cosine = select(cosine > ZERO, cosine, ZERO)
        rays.diffuse[lane] = ball.color * cosine
        # The mirror's point is found with a direction normalised once more, which may differ in its last bit.
        point = origin + unit(towards) * distance
        normal = unit(point - center)
        rays.origin[lane] = point
        rays.direction[lane] = normal * (TWO * dot(-towards, normal)) + towards


@inline
def finish(rays, level, table, environment):
    """`color` becomes the word of a pixel that has met its last ball: what mirrors show adds up from the last to the
    first."""
    probe, width, height = table.probe, table.probe_width, table.probe_height
    for lane in range(np.uint64(LANES)):
        seen = Vec3(ZERO, ZERO, ZERO)
        if environment:
            direction = rays.direction[lane]
            column = np.int32(REAL(width) * (direction.y / FOUR + HALF))
            row = np.int32(REAL(height) * (direction.z / FOUR + HALF))
            texel = np.int64(row) * width + np.int64(column)
            inside = (texel >= 0) & (texel < width * height)  # stale lanes hold anything
            seen = _texel(probe[select(inside, texel, np.int64(0))])
        color = rays.diffuse[lane] + seen
        if level == 2:
            color = rays.second[lane] + color
        if level >= 1:
            color = rays.first[lane] + color
        rays.color[lane] = np.int32(word(color, SPHERE))


@inline
def _texel(bits):
    """Red, green and blue of a word."""
    red, green, blue = bits & LOW_BYTE, bits >> np.uint32(8) & LOW_BYTE, bits >> np.uint32(16) & LOW_BYTE
    return Vec3(REAL(np.int32(red)), REAL(np.int32(green)), REAL(np.int32(blue)))


@inline
def _byte(x):
    """A channel clamped to 0 .. 255 and truncated."""
    x = select(x > ZERO, x, ZERO)
    return np.uint32(np.int32(select(x < MOST, x, MOST)))


@inline
def word(color, flag):
    """A pixel as it lies in memory: red in the lowest byte, the flag in the highest."""
    rgb = _byte(color.x) | _byte(color.y) << np.uint32(8) | _byte(color.z) << np.uint32(16)
    return rgb | np.uint32(flag) << np.uint32(24)
