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
from engines.dahlquist.numba_background import ALPHA, CHANNELS, Scratch, beside, draw_background
from engines.dahlquist.numba_colours import Tables, finish, reflect
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
    ZERO,
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
HELD_FIELDS = (ORIGIN, SECOND, WAITING)
"""How many fields rays of each level have in a queue."""


@inline
def _push(lanes, lane, level, queue, capacity, n):
    """Puts a ray that has met a ball into place n of a queue, with what rays of its level have."""
    _keep3(queue, DIRECTION * capacity + n, capacity, get3(lanes, DIRECTION, lane))
    keep(queue, DISTANCE * capacity + n, get(lanes, DISTANCE, lane))
    keep(queue, BALL * capacity + n, get(lanes, BALL, lane))
    keep(queue, PIXEL * capacity + n, get(lanes, PIXEL, lane))
    if level > 0:
        _keep3(queue, ORIGIN * capacity + n, capacity, get3(lanes, ORIGIN, lane))
        _keep3(queue, FIRST * capacity + n, capacity, get3(lanes, FIRST, lane))
    if level > 1:
        _keep3(queue, SECOND * capacity + n, capacity, get3(lanes, SECOND, lane))


@inline
def _pull(lanes, level, queue, capacity, first):
    """Takes sixteen rays that wait; beyond the last there are stale ones, which are harmless and never drawn."""
    for field in range(HELD_FIELDS[level]):
        for lane in range(np.uint64(LANES)):
            put(lanes, field, lane, fetch(queue, field * capacity + first + np.int64(lane)))
    if level == 0:
        for lane in range(np.uint64(LANES)):
            put3(lanes, ORIGIN, lane, Vec3(ZERO, ZERO, ZERO))


@inline
def _keep3(queue, place, stride, value):
    keep(queue, place, value.x)
    keep(queue, place + stride, value.y)
    keep(queue, place + 2 * stride, value.z)


@inline
def _mirror(lanes, level, queue, waiting, further, capacity, tables, flags, pixels):
    """Shades the rays of a queue; those whose mirrors show a ball go into the queue `further`. Returns how many these are."""
    balls = pointer(tables.balls, REAL)
    environment, reflections = flags
    n = 0
    for first in range(0, waiting, LANES):
        _pull(lanes, level, queue, capacity, first)
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
                _push(lanes, lane, level + 1, further, capacity, n)
                n += 1
            else:
                keep(pixels, np.int64(get_int(lanes, PIXEL, lane)), np.uint32(get_int(lanes, COLOUR, lane)))
    return n


@inline
def _row(lanes, row, size, spans, boxes, queue, waiting, capacity, tables, scratch, environment, pixels_at):
    """Primary rays of a row: those that meet a ball join the queue, the others' pixels show the background. Returns how many
    wait now."""
    balls, width = pointer(tables.balls, REAL), size[0]
    for k in range(BALLS):
        spans[k] = span(boxes, k, row, width)
    texel_rows = beside(row, size[1], tables)
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
                    _push(lanes, lane, 0, queue, capacity, waiting)
                    waiting += 1
        draw_background(lanes, begun, column, row, size, texel_rows, tables, scratch, environment, pixels_at)
    return waiting


def _draw(memory, capacity, tables, scratch, size, rows, flags, next_strip, pixels_at):
    """What one thread does: strips of rows, until there are none."""
    height = size[1]
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
                lanes, row, size, spans, boxes, one_queue, waiting, capacity, tables, scratch, flags[0], pixels_at
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
        self._probe, self._background = _words(pictures.probe), _flagged(pictures.background)
        self._stretch = _stretch(width, self._background.shape[1])
        # A line more than a strip needs: fields a power of two apart would fall into the same sets of the cache.
        self._capacity = -(-STRIP * width // LANES) * LANES + LANES
        memory = FIELDS * LANES + 2 * WAITING * self._capacity
        self._memory = [np.zeros(memory, REAL) for _ in range(threads)]
        self._rows = [np.zeros((2, CHANNELS * width), REAL) for _ in range(threads)]
        self._held = np.zeros((threads, 2), np.int64)
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
        self._held[:] = -1
        rows, flags = (view.first_row, view.row_step), (view.environment, view.reflections)

        def work(k: int) -> None:
            scratch = Scratch(self._rows[k].ctypes.data, self._held[k].ctypes.data)
            self._draw(
                self._memory[k].ctypes.data, self._capacity, tables, scratch, self._size, rows, flags,
                next_strip.ctypes.data, frame.ctypes.data,
            )  # fmt: skip

        others = [self._pool.submit(work, k) for k in range(1, len(self._memory))]
        work(0)
        for other in others:
            other.result()


def _flagged(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 4) numbers of red, green, blue, and what becomes the flag."""
    return np.ascontiguousarray(np.pad(picture.astype(REAL), ((0, 0), (0, 0), (0, 1)), constant_values=ALPHA))


def _words(picture: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """(h, w) words with red, green and blue in the three lower bytes."""
    red, green, blue = picture.astype(np.uint32).transpose(2, 0, 1)
    return np.ascontiguousarray(red | green << 8 | blue << 16)


def _stretch(width: int, texels: int) -> NDArray[np.float32]:
    """(width, 3) left texel, right texel and the right one's weight for each column of the image."""
    x = REAL(texels) * (np.arange(width).astype(REAL) / REAL(width))
    left = np.floor(x)
    return np.stack([left, np.minimum(np.ceil(x), texels - 1), x - left], axis=1).astype(REAL)
