"""The background behind sixteen pixels: bilinear, across first and then down, as the original adds it up.

A row of texels is stretched over the width of the image once, and serves every row of pixels beside it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.dahlquist.animation import REAL
from engines.dahlquist.frame import BACKGROUND, DARK
from engines.dahlquist.numba_rays import BALL, ONE
from engines.kernels.jit import LANES, fetch, get_int, inline, keep, pointer, select

DARK_WORD = np.uint32(DARK[0] | DARK[1] << 8 | DARK[2] << 16 | BACKGROUND << 24)
ALPHA = BACKGROUND + 0.5
"""The fourth number of every texel: however it is rounded on its way, cutting it off gives the flag."""
CHANNELS = 4


class Scratch(NamedTuple):
    """Addresses of a thread's own memory: two rows of texels, stretched, and which they are."""

    rows: int
    held: int


@inline
def beside(row, height, tables):
    """(upper, lower) row of texels beside a row of pixels, and the weight of the lower one."""
    y = REAL(tables.background_height) * (REAL(row) / REAL(height))
    upper = np.int64(y)
    lower = min(upper + (1 if REAL(upper) < y else 0), tables.background_height - 1)
    return upper, lower, y - REAL(upper)


@inline
def _stretched(row, width, tables, scratch):
    """The row of texels `row` as wide as the image: its place in the thread's memory."""
    rows, held, place = pointer(scratch.rows, REAL), pointer(scratch.held, np.int64), (row & 1) * CHANNELS * width
    if fetch(held, row & 1) != row:
        texels, stretch = pointer(tables.background, REAL), pointer(tables.stretch, REAL)
        first = row * tables.background_width
        for x in range(width):
            left = CHANNELS * (first + np.int64(fetch(stretch, 3 * x)))
            right = CHANNELS * (first + np.int64(fetch(stretch, 3 * x + 1)))
            share = fetch(stretch, 3 * x + 2)
            red = fetch(texels, left) * (ONE - share) + fetch(texels, right) * share
            green = fetch(texels, left + 1) * (ONE - share) + fetch(texels, right + 1) * share
            blue = fetch(texels, left + 2) * (ONE - share) + fetch(texels, right + 2) * share
            flag = fetch(texels, left + 3) * (ONE - share) + fetch(texels, right + 3) * share
            keep(rows, place + CHANNELS * x, red)
            keep(rows, place + CHANNELS * x + 1, green)
            keep(rows, place + CHANNELS * x + 2, blue)
            keep(rows, place + CHANNELS * x + 3, flag)
        keep(held, row & 1, row)
    return place


@inline
def draw_background(lanes, begun, column, row, size, texel_rows, tables, scratch, environment, pixels_at):
    """The background where nothing was met, unless it is there already, in sixteen pixels of a row from `column` on."""
    width = size[0]
    many, first = min(LANES, width - column), row * width + column
    pixels, bytes_at = pointer(pixels_at, np.uint32), pointer(pixels_at + 4 * first, np.uint8)
    wanted = 0
    for lane in range(np.uint64(many)):
        there = fetch(pixels, first + np.int64(lane)) >> np.uint32(24) == np.uint32(BACKGROUND)
        met = begun & (get_int(lanes, BALL, lane) >= 0)
        wanted += select(there | met, np.int64(0), np.int64(1))
    if wanted == 0:
        return
    upper, lower, share = texel_rows
    above = below = np.int64(0)
    if environment:
        above = _stretched(upper, width, tables, scratch) + CHANNELS * column
        below = _stretched(lower, width, tables, scratch) + CHANNELS * column
    rows = pointer(scratch.rows, REAL)
    if environment and wanted == LANES:
        for k in range(CHANNELS * LANES):
            value = fetch(rows, above + k) * (ONE - share) + fetch(rows, below + k) * share
            keep(bytes_at, k, np.uint8(np.int32(value)))
        return
    for lane in range(np.uint64(many)):
        n = np.int64(lane)
        if (begun and get_int(lanes, BALL, lane) >= 0) or fetch(pixels, first + n) >> np.uint32(24) == BACKGROUND:
            continue
        if not environment:
            keep(pixels, first + n, DARK_WORD)
            continue
        for k in range(CHANNELS * n, CHANNELS * n + CHANNELS):
            value = fetch(rows, above + k) * (ONE - share) + fetch(rows, below + k) * share
            keep(bytes_at, k, np.uint8(np.int32(value)))
