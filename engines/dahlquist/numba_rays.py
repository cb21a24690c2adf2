"""Sixteen rays at a time: where they start, which balls they may meet, and which they meet first.

Compiled code in the original's float32 order of operations; squares are formed and added in float64 and rounded once.
"""

from __future__ import annotations

import math

import numpy as np

from engines.dahlquist.animation import FOCAL, RADII, REAL
from engines.kernels.block import get3, put3
from engines.kernels.jit import LANES, fetch, get, get_int, inline, put, put_int, select
from engines.kernels.vector import Vec3, dot

# fields of a block, sixteen numbers each; the first WAITING of them are a queue's too
DIRECTION, DISTANCE, BALL, PIXEL, ORIGIN, FIRST, SECOND = 0, 3, 4, 5, 6, 9, 12
WAITING = 15
TOWARDS, DIFFUSE, TRIED, COLOUR = 15, 18, 21, 22
FIELDS = 23

BALLS = len(RADII)
BALL_REALS = 8  # centre 3, radius, colour 3, spare
BOX_REALS = 4
ZERO, HALF, ONE, FAR = (REAL(x) for x in (0, 0.5, 1, np.inf))
SLACK, STEEP = REAL(1e-5), REAL(0.999)
"""What widens the spans of rows, and the largest y that they distinguish."""
RIM = REAL(1.00001)
"""What widens squared radii where squares are formed in float32."""


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
def centre_of(balls, k):
    return Vec3(fetch(balls, k * BALL_REALS), fetch(balls, k * BALL_REALS + 1), fetch(balls, k * BALL_REALS + 2))


@inline
def primary_rays(lanes, column, row, width):
    """Directions of sixteen pixels of a row, from `column` on."""
    z = REAL(row) / REAL(width) - HALF
    for lane in range(np.uint64(LANES)):
        y = REAL(np.int32(column) + np.int32(lane)) / REAL(width) - HALF
        put3(lanes, DIRECTION, lane, unit(Vec3(FOCAL, y, z)))
        put3(lanes, ORIGIN, lane, Vec3(ZERO, ZERO, ZERO))


@inline
def begin_search(lanes):
    for lane in range(np.uint64(LANES)):
        put3(lanes, TOWARDS, lane, unit(get3(lanes, DIRECTION, lane)))
        put(lanes, DISTANCE, lane, FAR)
        put_int(lanes, BALL, lane, np.int32(-1))


@inline
def span(boxes, k, row, width):
    """(first, last) column of a row between which directions may lie in the box of ball k, a pixel wider than needed."""
    z = REAL(row) / REAL(width) - HALF
    plane = FOCAL * FOCAL + z * z
    low, high = fetch(boxes, k * BOX_REALS), fetch(boxes, k * BOX_REALS + 1)
    first = np.int64(_column(low, plane, width)) - 1
    last = np.int64(_column(high, plane, width)) + 2
    nearest, farthest = z / np.sqrt(plane), z / np.sqrt(plane + HALF)
    z0, z1 = fetch(boxes, k * BOX_REALS + 2) - SLACK, fetch(boxes, k * BOX_REALS + 3) + SLACK
    if max(nearest, farthest) < z0 or min(nearest, farthest) > z1:
        last = first - 1
    return first, last


@inline
def _column(y, plane, width):
    """The column, inside the image or just outside, where unit directions have this y."""
    y = max(min(y, STEEP), -STEEP)
    column = (y * np.sqrt(plane / (ONE - y * y)) + HALF) * REAL(width)
    return max(min(column, REAL(width)), -ONE)


@inline
def in_box(lanes, boxes, k):
    """How many of the sixteen directions lie inside the box of ball k; their TRIED is 1."""
    y0, y1 = fetch(boxes, k * BOX_REALS), fetch(boxes, k * BOX_REALS + 1)
    z0, z1 = fetch(boxes, k * BOX_REALS + 2), fetch(boxes, k * BOX_REALS + 3)
    inside = np.int32(0)
    for lane in range(np.uint64(LANES)):
        y, z = get(lanes, DIRECTION + 1, lane), get(lanes, DIRECTION + 2, lane)
        within = (y >= y0) & (y <= y1) & (z >= z0) & (z <= z1)
        put(lanes, TRIED, lane, select(within, ONE, -ONE))
        inside += select(within, np.int32(1), np.int32(0))
    return inside


@inline
def _near(lanes, balls, k):
    """How many of the sixteen lines pass near ball k ahead of their origins, or through it; their TRIED is 1.

    The squares are formed in float32, which is off by less than `RIM` in the last bits: `meet` decides."""
    centre, radius = centre_of(balls, k), fetch(balls, k * BALL_REALS + 3)
    reach = radius * radius * RIM
    found = np.int32(0)
    for lane in range(np.uint64(LANES)):
        origin, towards = get3(lanes, ORIGIN, lane), get3(lanes, TOWARDS, lane)
        t = dot(get3(lanes, DIRECTION, lane), centre - origin)
        off = origin + towards * t - centre
        within = (t > ZERO) & (dot(off, off) <= reach)
        put(lanes, TRIED, lane, select(within, ONE, -ONE))
        found += select(within, np.int32(1), np.int32(0))
    return found


@inline
def meet(lanes, balls, k):
    """Takes the entry into ball k where TRIED is positive and it is the nearest so far."""
    centre, radius = centre_of(balls, k), np.float64(fetch(balls, k * BALL_REALS + 3))
    for lane in range(np.uint64(LANES)):
        origin, direction, towards = get3(lanes, ORIGIN, lane), get3(lanes, DIRECTION, lane), get3(lanes, TOWARDS, lane)
        t = dot(direction, centre - origin)
        near = origin + towards * t
        left = radius * radius - np.float64(_squared_length(near - centre))
        along = np.float64(np.sqrt(_squared_length(near - origin)))
        entry = REAL(along - math.sqrt(select(left > 0.0, left, 0.0)))
        best, ball = get(lanes, DISTANCE, lane), get_int(lanes, BALL, lane)
        closer = (t > ZERO) & (left >= 0.0) & (entry >= ZERO) & (entry < best) & (get(lanes, TRIED, lane) > ZERO)
        put(lanes, DISTANCE, lane, select(closer, entry, best))
        put_int(lanes, BALL, lane, select(closer, np.int32(k), ball))


@inline
def search(lanes, balls):
    """The nearest ball of each lane's ray, by the plain list."""
    begin_search(lanes)
    for k in range(BALLS):
        if _near(lanes, balls, k) > 0:
            meet(lanes, balls, k)
