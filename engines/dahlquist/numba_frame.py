"""The frame in compiled code, for `threads` threads.

A thread takes strips of rows. Primary rays run in blocks of sixteen; those that meet a ball wait in a queue, so that
the blocks of the next stage are full again, and so on for each mirror.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.dahlquist.animation import COLOURS, RADII, REAL
from engines.dahlquist.frame import Frame, Pictures, View
from engines.dahlquist.numba_background import ALPHA, CHANNELS, StretchedRows, beside, draw_background
from engines.dahlquist.numba_colours import FrameTable, finish, frame_table, reflect
from engines.dahlquist.numba_rays import (
    BALLS,
    ZERO,
    BallRow,
    RayBatch,
    WaitingRays,
    begin_search,
    column_span,
    in_box,
    intersect,
    primary_rays,
    ray_batch,
    search,
    waiting_rays,
)
from engines.dahlquist.numpy_frame import HITS
from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import LANES
from engines.kernels.compile.values import fetch_add
from engines.kernels.lane.vector import Vec3

STRIP = 4
"""Rows that a thread takes at once."""
RAYS_BYTES, WAITING_BYTES = RayBatch.bytes(REAL), WaitingRays.bytes(REAL)


@inline
def _push(rays, lane, level, queue, n):
    """Puts a ray that has met a ball into place n of a queue, with what rays of its level have."""
    waiting, place = queue[n // LANES], n % LANES
    waiting.direction[place] = rays.direction[lane]
    waiting.distance[place] = rays.distance[lane]
    waiting.ball[place] = rays.ball[lane]
    waiting.pixel[place] = rays.pixel[lane]
    if level > 0:
        waiting.origin[place] = rays.origin[lane]
        waiting.first[place] = rays.first[lane]
    if level > 1:
        waiting.second[place] = rays.second[lane]


@inline
def _pull(rays, level, waiting):
    """Takes sixteen rays that wait; beyond the last there are stale ones, which are harmless and never drawn."""
    for lane in range(np.uint64(LANES)):
        rays.direction[lane] = waiting.direction[lane]
        rays.distance[lane] = waiting.distance[lane]
        rays.ball[lane] = waiting.ball[lane]
        rays.pixel[lane] = waiting.pixel[lane]
        rays.origin[lane] = waiting.origin[lane] if level > 0 else Vec3(ZERO, ZERO, ZERO)
    if level > 0:
        for lane in range(np.uint64(LANES)):
            rays.first[lane] = waiting.first[lane]
    if level > 1:
        for lane in range(np.uint64(LANES)):
            rays.second[lane] = waiting.second[lane]


@inline
def _mirror(rays, level, queue, waiting, further, table, flags, pixels):
    """Shades the rays of a queue; those whose mirrors show a ball go into the queue `further`. Returns how many these
    are."""
    balls = table.balls
    environment, reflections = flags
    n = 0
    for first in range(0, waiting, LANES):
        _pull(rays, level, queue[first // LANES])
        reflect(rays, balls)
        for lane in range(np.uint64(LANES)):
            rays.ball[lane] = np.int32(-1)
        if reflections and level < HITS - 1:
            search(rays, balls)
        finish(rays, level, table, environment)
        for lane in range(np.uint64(LANES)):
            diffuse = rays.diffuse[lane]
            if level == 0:
                rays.first[lane] = diffuse
            if level == 1:
                rays.second[lane] = diffuse
        for lane in range(np.uint64(min(LANES, waiting - first))):
            if rays.ball[lane] >= 0:
                _push(rays, lane, level + 1, further, n)
                n += 1
            else:
                pixels[rays.pixel[lane]] = np.uint32(rays.color[lane])
    return n


@inline
def _row(rays, row, size, spans, queue, waiting, table, stretched, environment, pixels_at):
    """Primary rays of a row: those that meet a ball join the queue, the others' pixels show the background. Returns how
    many wait now."""
    balls, boxes, width = table.balls, table.boxes, size[0]
    for k in range(BALLS):
        spans[k] = column_span(boxes[k], row, width)
    texel_rows = beside(row, size[1], table)
    for column in range(0, width, LANES):
        begun = False
        for k in range(BALLS):
            if spans[k][0] < column + LANES and spans[k][1] >= column:
                if not begun:
                    primary_rays(rays, column, row, width)
                    begin_search(rays)
                    begun = True
                if in_box(rays, boxes[k]) > 0:
                    intersect(rays, balls[k], k)
        if begun:
            for lane in range(np.uint64(min(LANES, width - column))):
                if rays.ball[lane] >= 0:
                    rays.pixel[lane] = np.int32(row * width + column) + np.int32(lane)
                    _push(rays, lane, 0, queue, waiting)
                    waiting += 1
        draw_background(rays, begun, column, row, size, texel_rows, table, stretched, environment, pixels_at)
    return waiting


def _draw(memory, queue_bytes, table_at, texels_at, index_at, size, rows, flags, next_strip, pixels_at):
    """What one thread does: strips of rows, until there are none. `memory` holds a batch of rays and two queues."""
    height = size[1]
    first_row, row_step = rows
    rays, table = ray_batch(memory, REAL), frame_table(table_at, REAL)
    one_queue = waiting_rays(memory + RAYS_BYTES, REAL)
    other_queue = waiting_rays(memory + RAYS_BYTES + queue_bytes, REAL)
    stretched = StretchedRows(array_at(texels_at, REAL), array_at(index_at, np.int64))
    pixels = array_at(pixels_at, np.uint32)
    spans = [(np.int64(0), np.int64(0)) for _ in range(BALLS)]
    while True:
        start = first_row + fetch_add(next_strip, 1) * STRIP * row_step
        if start >= height:
            return
        waiting = 0
        for row in range(start, min(start + STRIP * row_step, height), row_step):
            waiting = _row(rays, row, size, spans, one_queue, waiting, table, stretched, flags[0], pixels_at)
        here, there = one_queue, other_queue
        for level in range(HITS):
            waiting = _mirror(rays, level, here, waiting, there, table, flags, pixels)
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
        self._queue_bytes = -(-STRIP * width // LANES) * WAITING_BYTES
        self._memory = [np.zeros(RAYS_BYTES + 2 * self._queue_bytes, np.uint8) for _ in range(threads)]
        self._texels = [np.zeros((2, CHANNELS * width), REAL) for _ in range(threads)]
        self._texel_rows = np.zeros((threads, 2), np.int64)
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="dahlquist")
        self._draw = _compiled()

    def _table(self, **arrays: Any) -> NDArray[np.int64]:
        """The slots of a `FrameTable`; these arrays must outlive its use."""
        (probe_height, probe_width), (height, width, _) = self._probe.shape, self._background.shape
        arrays |= {"probe": self._probe, "background": self._background, "stretch": self._stretch}
        values = {
            "probe_width": probe_width,
            "probe_height": probe_height,
            "background_width": width,
            "background_height": height,
            **{name: array.ctypes.data for name, array in arrays.items()},
        }
        return np.array([values[name] for name in FrameTable.fields], np.int64)

    def draw(self, frame: Frame, view: View) -> None:
        """Draws the rows of a call into `frame`."""
        balls = np.zeros((BALLS, BallRow.size), REAL)
        balls[:, :3], balls[:, 3], balls[:, 4:7] = view.centres, RADII, COLOURS
        boxes = np.ascontiguousarray(view.boxes, REAL)
        table = self._table(balls=balls, boxes=boxes)
        next_strip = np.zeros(1, np.int64)
        self._texel_rows[:] = -1
        rows, flags = (view.first_row, view.row_step), (view.environment, view.reflections)

        def work(k: int) -> None:
            self._draw(
                self._memory[k].ctypes.data,
                self._queue_bytes,
                table.ctypes.data,
                self._texels[k].ctypes.data,
                self._texel_rows[k].ctypes.data,
                self._size,
                rows,
                flags,
                next_strip.ctypes.data,
                frame.ctypes.data,
            )

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
