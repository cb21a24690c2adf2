"""What sixteen rays see of balls, and of the probe in their mirrors; and pixels as they lie in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.dahlquist.animation import REAL
from engines.dahlquist.frame import SPHERE
from engines.dahlquist.numba_rays import (
    BALL,
    BALL_REALS,
    COLOUR,
    DIFFUSE,
    DIRECTION,
    DISTANCE,
    FIRST,
    HALF,
    ORIGIN,
    SECOND,
    ZERO,
    centre_of,
    unit,
)  # fmt: skip
from engines.dahlquist.numpy_frame import TO_LIGHT
from engines.kernels.block import get3, put3
from engines.kernels.jit import LANES, fetch, get, get_int, inline, pointer, put_int, select
from engines.kernels.vector import Vec3, dot

TWO, FOUR, MOST = (REAL(x) for x in (2, 4, 255))
TO_LIGHT_X, TO_LIGHT_Y, TO_LIGHT_Z = (REAL(x) for x in TO_LIGHT[:, 0])
LOW_BYTE = np.uint32(255)


class Tables(NamedTuple):
    """Addresses of what all threads read, and sizes."""

    balls: int
    boxes: int
    probe: int
    probe_width: int
    probe_height: int
    background: int
    background_width: int
    background_height: int
    stretch: int


@inline
def reflect(lanes, balls):
    """Shades the ball that each lane has met, and turns the lane's ray into the mirrored one."""
    for lane in range(np.uint64(LANES)):
        origin, distance = get3(lanes, ORIGIN, lane), get(lanes, DISTANCE, lane)
        ball = np.int64(get_int(lanes, BALL, lane))
        centre = centre_of(balls, ball)
        towards = unit(get3(lanes, DIRECTION, lane))
        normal = unit(origin + towards * distance - centre)
        cosine = TO_LIGHT_X * normal.x + TO_LIGHT_Y * normal.y + TO_LIGHT_Z * normal.z
        cosine = select(cosine > ZERO, cosine, ZERO)
        k = ball * BALL_REALS + 4
        put3(lanes, DIFFUSE, lane, Vec3(fetch(balls, k), fetch(balls, k + 1), fetch(balls, k + 2)) * cosine)
        # The mirror's point is found with a direction normalised once more, which may differ in its last bit.
        point = origin + unit(towards) * distance
        normal = unit(point - centre)
        put3(lanes, ORIGIN, lane, point)
        put3(lanes, DIRECTION, lane, normal * (TWO * dot(-towards, normal)) + towards)


@inline
def finish(lanes, level, tables, environment):
    """COLOUR becomes the word of a pixel that has met its last ball: what mirrors show adds up from the last to the first."""
    probe = pointer(tables.probe, np.uint32)
    for lane in range(np.uint64(LANES)):
        seen = Vec3(ZERO, ZERO, ZERO)
        if environment:
            column = np.int32(REAL(tables.probe_width) * (get(lanes, DIRECTION + 1, lane) / FOUR + HALF))
            row = np.int32(REAL(tables.probe_height) * (get(lanes, DIRECTION + 2, lane) / FOUR + HALF))
            texel = np.int64(row) * tables.probe_width + np.int64(column)
            inside = (texel >= 0) & (texel < tables.probe_width * tables.probe_height)  # stale lanes hold anything
            seen = _texel(fetch(probe, select(inside, texel, np.int64(0))))
        colour = get3(lanes, DIFFUSE, lane) + seen
        if level == 2:
            colour = get3(lanes, SECOND, lane) + colour
        if level >= 1:
            colour = get3(lanes, FIRST, lane) + colour
        put_int(lanes, COLOUR, lane, np.int32(word(colour, SPHERE)))


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
def word(colour, flag):
    """A pixel as it lies in memory: red in the lowest byte, the flag in the highest."""
    rgb = _byte(colour.x) | _byte(colour.y) << np.uint32(8) | _byte(colour.z) << np.uint32(16)
    return rgb | np.uint32(flag) << np.uint32(24)
