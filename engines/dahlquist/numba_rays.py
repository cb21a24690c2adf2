"""Sixteen rays at a time: where they start, which balls they may meet, and which they meet first.

Compiled code in the original's float32 order of operations; squares are formed and added in float64 and rounded once.
"""

from __future__ import annotations

import math

import numpy as np

from engines.dahlquist.animation import FOCAL, RADII, REAL
from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import LANES, LaneRecord, Row, integer, lane_view, real, vector
from engines.kernels.compile.values import select
from engines.kernels.lane.vector import Vec3, dot

BALLS = len(RADII)
ZERO, HALF, ONE, FAR = (REAL(x) for x in (0, 0.5, 1, np.inf))
SPAN_MARGIN, MAX_Y = REAL(1e-5), REAL(0.999)
"""What widens the spans of rows, and the largest y that they distinguish."""
RADIUS_MARGIN = REAL(1.00001)
"""What widens squared radii where squares are formed in float32."""


class RayBatch(LaneRecord):
    """Sixteen rays."""

    direction = vector()
    distance = real()
    ball = integer()  # the nearest so far, -1 for none
    pixel = integer()
    origin = vector()
    first = vector()  # diffuse colours of the balls met before
    second = vector()
    unit_direction = vector()  # the direction normalised once more
    diffuse = vector()  # of the ball met
    candidate = real()  # above 0 where the ball at hand may be met
    color = integer()  # the pixel as it lies in memory


class WaitingRays(LaneRecord):
    """Rays in a queue, each having met a ball: as in `RayBatch`."""

    direction = vector()
    distance = real()
    ball = integer()
    pixel = integer()
    origin = vector()
    first = vector()
    second = vector()


class BallRow(Row):
    dtype = REAL
    center = vector()
    radius = real()
    color = vector()
    spare = real()


class BoxRow(Row):
    """Of directions, in their y and z."""

    dtype = REAL
    y_low = real()
    y_high = real()
    z_low = real()
    z_high = real()


ray_batch = lane_view(RayBatch)
waiting_rays = lane_view(WaitingRays)


@inline
def _squared_length(a):
    """Squares and their sum in float64, rounded once."""
    x, y, z = np.float64(a.x), np.float64(a.y), np.float64(a.z)
    return REAL(x * x + y * y + z * z)


@inline
def unit(a):
    length = np.sqrt(_squared_length(a))
    return Vec3(a.x / length, a.y / length, a.z / length)


@inline
def primary_rays(rays, column, row, width):
    """Directions of sixteen pixels of a row, from `column` on."""
    z = REAL(row) / REAL(width) - HALF
    for lane in range(np.uint64(LANES)):
        y = REAL(np.int32(column) + np.int32(lane)) / REAL(width) - HALF
        rays.direction[lane] = unit(Vec3(FOCAL, y, z))
        rays.origin[lane] = Vec3(ZERO, ZERO, ZERO)


@inline
def begin_search(rays):
    for lane in range(np.uint64(LANES)):
        rays.unit_direction[lane] = unit(rays.direction[lane])
        rays.distance[lane] = FAR
        rays.ball[lane] = np.int32(-1)


@inline
def column_span(box, row, width):
    """(first, last) column of a row between which directions may lie in the box, a pixel wider than needed."""
    z = REAL(row) / REAL(width) - HALF
    plane = FOCAL * FOCAL + z * z
    first = np.int64(_column(box.y_low, plane, width)) - 1
    last = np.int64(_column(box.y_high, plane, width)) + 2
    nearest, farthest = z / np.sqrt(plane), z / np.sqrt(plane + HALF)
    z_low, z_high = box.z_low - SPAN_MARGIN, box.z_high + SPAN_MARGIN
    if max(nearest, farthest) < z_low or min(nearest, farthest) > z_high:
        last = first - 1
    return first, last


@inline
def _column(y, plane, width):
    """The column, inside the image or just outside, where unit directions have this y."""
    y = max(min(y, MAX_Y), -MAX_Y)
    column = (y * np.sqrt(plane / (ONE - y * y)) + HALF) * REAL(width)
    return max(min(column, REAL(width)), -ONE)


@inline
def in_box(rays, box):
    """How many of the sixteen directions lie inside the box: those are candidates."""
    y_low, y_high, z_low, z_high = box.y_low, box.y_high, box.z_low, box.z_high
    inside = np.int32(0)
    for lane in range(np.uint64(LANES)):
        y, z = rays.direction[lane].y, rays.direction[lane].z
        within = (y >= y_low) & (y <= y_high) & (z >= z_low) & (z <= z_high)
        rays.candidate[lane] = select(within, ONE, -ONE)
        inside += select(within, np.int32(1), np.int32(0))
    return inside


@inline
def _passes_near(rays, ball):
    """How many of the sixteen lines pass near the ball ahead of their origins, or through it: those are candidates.

    The squares are formed in float32, which is off by less than `RADIUS_MARGIN` in the last bits: `intersect`
    decides."""
    center, radius = ball.center, ball.radius
    largest = radius * radius * RADIUS_MARGIN
    found = np.int32(0)
    for lane in range(np.uint64(LANES)):
        origin, unit_direction = rays.origin[lane], rays.unit_direction[lane]
        t = dot(rays.direction[lane], center - origin)
        off = origin + unit_direction * t - center
        within = (t > ZERO) & (dot(off, off) <= largest)
        rays.candidate[lane] = select(within, ONE, -ONE)
        found += select(within, np.int32(1), np.int32(0))
    return found


@inline
def intersect(rays, ball, k):
    """Takes the entry into ball k for candidates whose nearest it is so far."""
    center, radius = ball.center, np.float64(ball.radius)
    for lane in range(np.uint64(LANES)):
        origin, direction, unit_direction = rays.origin[lane], rays.direction[lane], rays.unit_direction[lane]
        t = dot(direction, center - origin)
        near = origin + unit_direction * t
        left = radius * radius - np.float64(_squared_length(near - center))
        along = np.float64(np.sqrt(_squared_length(near - origin)))
        entry = REAL(along - math.sqrt(select(left > 0.0, left, 0.0)))
        nearest, found = rays.distance[lane], rays.ball[lane]
        closer = (t > ZERO) & (left >= 0.0) & (entry >= ZERO) & (entry < nearest) & (rays.candidate[lane] > ZERO)
        rays.distance[lane] = select(closer, entry, nearest)
        rays.ball[lane] = select(closer, np.int32(k), found)


@inline
def search(rays, balls):
    """The nearest ball of each lane's ray, by the plain list."""
    begin_search(rays)
    for k in range(BALLS):
        if _passes_near(rays, balls[k]) > 0:
            intersect(rays, balls[k], k)
