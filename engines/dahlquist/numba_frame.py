"""The frame in compiled code, for `threads` threads.

A thread takes strips of rows. Primary rays run in blocks of sixteen; those that meet a ball wait in a queue, so that the
blocks of the next stage are full again, and so on for each mirror.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.dahlquist.animation import COLOURS, RADII, REAL
from engines.dahlquist.frame import Frame, Pictures, View
from engines.dahlquist.numba_colours import Tables, draw_background, finish, reflect
from engines.dahlquist.numba_rays import (
    BALL,
    BALL_REALS,
    BALLS,
    COLOUR,
    DIFFUSE,
    DIRECTION,
    DISTANCE,
    FIELDS,
    FIRST,
    ORIGIN,
    PIXEL,
    SECOND,
    WAITING,
    begin_search,
    in_box,
    meet,
    primary_rays,
    search,
    span,
)  # fmt: skip
from engines.dahlquist.numpy_frame import HITS
from engines.kernels.block import get3, put3
from engines.kernels.jit import LANES, fetch, fetch_add, get, get_int, inline, keep, kernel, pointer, put, put_int
from engines.kernels.vector import Vec3

STRIP = 4
"""Rows that a thread takes at once."""


@inline
def _push(lanes, lane, queue, capacity, n):
    """Puts a ray that has met a ball into place n of a queue."""
    _keep3(queue, DIRECTION * capacity + n, capacity, get3(lanes, DIRECTION, lane))
    _keep3(queue, ORIGIN * capacity + n, capacity, get3(lanes, ORIGIN, lane))
    _keep3(queue, FIRST * capacity + n, capacity, get3(lanes, FIRST, lane))
    _keep3(queue, SECOND * capacity + n, capacity, get3(lanes, SECOND, lane))
    keep(queue, DISTANCE * capacity + n, get(lanes, DISTANCE, lane))
    keep(queue, BALL * capacity + n, get(lanes, BALL, lane))
    keep(queue, PIXEL * capacity + n, get(lanes, PIXEL, lane))


@inline
def _pull(lanes, queue, capacity, first):
    """Takes sixteen rays that wait; beyond the last there are stale ones, which are harmless and never drawn."""
    for lane in range(np.uint64(LANES)):
        n = first + np.int64(lane)
        put3(lanes, DIRECTION, lane, _fetch3(queue, DIRECTION * capacity + n, capacity))
        put3(lanes, ORIGIN, lane, _fetch3(queue, ORIGIN * capacity + n, capacity))
        put3(lanes, FIRST, lane, _fetch3(queue, FIRST * capacity + n, capacity))
        put3(lanes, SECOND, lane, _fetch3(queue, SECOND * capacity + n, capacity))
        put(lanes, DISTANCE, lane, fetch(queue, DISTANCE * capacity + n))
        put(lanes, BALL, lane, fetch(queue, BALL * capacity + n))
        put(lanes, PIXEL, lane, fetch(queue, PIXEL * capacity + n))


@inline
def _keep3(queue, place, stride, value):
    keep(queue, place, value.x)
    keep(queue, place + stride, value.y)
    keep(queue, place + 2 * stride, value.z)


@inline
def _fetch3(queue, place, stride):
    return Vec3(fetch(queue, place), fetch(queue, place + stride), fetch(queue, place + 2 * stride))


@inline
def _mirror(lanes, level, queue, waiting, further, capacity, tables, flags, pixels):
    """Shades the rays of a queue; those whose mirrors show a ball go into the queue `further`. Returns how many these are."""
    balls = pointer(tables.balls, REAL)
    environment, reflections = flags
    n = 0
    for first in range(0, waiting, LANES):
        _pull(lanes, queue, capacity, first)
        reflect(lanes, balls)
        for lane in range(np.uint64(LANES)):
            put_int(lanes, BALL, lane, np.int32(-1))
        if reflections and level < HITS - 1:
            search(lanes, balls)
        finish(lanes, level, tables, environment)
        for lane in range(np.uint64(LANES)):
            diffuse = get3(lanes, DIFFUSE, lane)
            if level == 0:
                put3(lanes, FIRST, lane, diffuse)
            if level == 1:
                put3(lanes, SECOND, lane, diffuse)
        for lane in range(np.uint64(min(LANES, waiting - first))):
            if get_int(lanes, BALL, lane) >= 0:
                _push(lanes, lane, further, capacity, n)
                n += 1
            else:
                keep(pixels, np.int64(get_int(lanes, PIXEL, lane)), np.uint32(get_int(lanes, COLOUR, lane)))
    return n


@inline
def _row(lanes, row, width, spans, boxes, queue, waiting, capacity, tables, environment, pixels, height):
    """Primary rays of a row: those that meet a ball join the queue, the others' pixels show the background. Returns how many
    wait now."""
    balls = pointer(tables.balls, REAL)
    for k in range(BALLS):
        spans[k] = span(boxes, k, row, width)
    for column in range(0, width, LANES):
        begun = False
        for k in range(BALLS):
            if spans[k][0] < column + LANES and spans[k][1] >= column:
                if not begun:
                    primary_rays(lanes, column, row, width)
                    begin_search(lanes)
                    begun = True
                if in_box(lanes, boxes, k) > 0:
                    meet(lanes, balls, k)
        if begun:
            for lane in range(np.uint64(min(LANES, width - column))):
                if get_int(lanes, BALL, lane) >= 0:
                    put_int(lanes, PIXEL, lane, np.int32(row * width + column) + np.int32(lane))
                    _push(lanes, lane, queue, capacity, waiting)
                    waiting += 1
        draw_background(lanes, begun, column, row, width, height, tables, environment, pixels)
    return waiting


def _draw(memory, capacity, tables, size, rows, flags, next_strip, pixels_at):
    """What one thread does: strips of rows, until there are none."""
    width, height = size
    first_row, row_step = rows
    lanes, one_queue = pointer(memory, REAL), pointer(memory + 4 * FIELDS * LANES, REAL)
    other_queue = pointer(memory + 4 * (FIELDS * LANES + WAITING * capacity), REAL)
    pixels, boxes = pointer(pixels_at, np.uint32), pointer(tables.boxes, REAL)
    spans = [(np.int64(0), np.int64(0)) for _ in range(BALLS)]
    while True:
        start = first_row + fetch_add(next_strip, 1) * STRIP * row_step
        if start >= height:
            return
        waiting = 0
        for row in range(start, min(start + STRIP * row_step, height), row_step):
            waiting = _row(
                lanes, row, width, spans, boxes, one_queue, waiting, capacity, tables, flags[0], pixels, height
            )  # fmt: skip
        here, there = one_queue, other_queue
        for level in range(HITS):
            waiting = _mirror(lanes, level, here, waiting, there, capacity, tables, flags, pixels)
            here, there = there, here


@cache
def _compiled() -> Any:
    return kernel(_draw)


class Painter:
    """Draws frames of one size on `threads` threads."""

    def __init__(self, width: int, height: int, pictures: Pictures, threads: int) -> None:
        self._size = width, height
        self._probe, self._background = _words(pictures.probe), _padded(pictures.background)
        self._stretch = _stretch(width, self._background.shape[1])
        # A line more than a strip needs: fields a power of two apart would fall into the same sets of the cache.
        self._capacity = -(-STRIP * width // LANES) * LANES + LANES
        memory = FIELDS * LANES + 2 * WAITING * self._capacity
        self._memory = [np.zeros(memory, REAL) for _ in range(threads)]
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="dahlquist")
        self._draw = _compiled()

    def draw(self, frame: Frame, view: View) -> None:
        """Draws the rows of a call into `frame`."""
        balls = np.zeros((BALLS, BALL_REALS), REAL)
        balls[:, :3], balls[:, 3], balls[:, 4:7] = view.centres, RADII, COLOURS
        boxes = np.ascontiguousarray(view.boxes, REAL)
        (probe_height, probe_width), (height, width, _) = self._probe.shape, self._background.shape
        tables = Tables(
            balls.ctypes.data, boxes.ctypes.data, self._probe.ctypes.data, probe_width, probe_height,
            self._background.ctypes.data, width, height, self._stretch.ctypes.data,
        )  # fmt: skip
        next_strip = np.zeros(1, np.int64)
        rows, flags = (view.first_row, view.row_step), (view.environment, view.reflections)

        def work(memory: NDArray[np.float32]) -> None:
            self._draw(
                memory.ctypes.data, self._capacity, tables, self._size, rows, flags, next_strip.ctypes.data,
                frame.ctypes.data,
            )  # fmt: skip

        list(self._pool.map(work, self._memory))


def _padded(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 4) numbers of red, green, blue, and 0."""
    return np.ascontiguousarray(np.pad(picture, ((0, 0), (0, 0), (0, 1))), REAL)


def _words(picture: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """(h, w) words with red, green and blue in the three lower bytes."""
    red, green, blue = picture.astype(np.uint32).transpose(2, 0, 1)
    return np.ascontiguousarray(red | green << 8 | blue << 16)


def _stretch(width: int, texels: int) -> NDArray[np.float32]:
    """(width, 3) left texel, right texel and the right one's weight for each column of the image."""
    x = REAL(texels) * (np.arange(width).astype(REAL) / REAL(width))
    left = np.floor(x)
    return np.stack([left, np.minimum(np.ceil(x), texels - 1), x - left], axis=1).astype(REAL)
