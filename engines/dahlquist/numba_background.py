"""The background behind sixteen pixels: bilinear, across first and then down, as the original adds it up.

A row of texels is stretched over the width of the image once, and serves every row of pixels beside it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.dahlquist.animation import REAL
from engines.dahlquist.frame import BACKGROUND, DARK
from engines.dahlquist.numba_rays import ONE
from engines.kernels.compile.jit import inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import LANES
from engines.kernels.compile.values import select

DARK_WORD = np.uint32(DARK[0] | DARK[1] << 8 | DARK[2] << 16 | BACKGROUND << 24)
ALPHA = BACKGROUND + 0.5
"""The fourth number of every texel: however it is rounded on its way, cutting it off gives the flag."""
CHANNELS = 4


class StretchedRows(NamedTuple):
    """A thread's own memory: two rows of texels, stretched, and which they are."""

    texels: Any
    index: Any


@inline
def beside(row, height, table):
    """(upper, lower) row of texels beside a row of pixels, and the weight of the lower one."""
    y = REAL(table.background_height) * (REAL(row) / REAL(height))
    upper = np.int64(y)
    lower = min(upper + (1 if REAL(upper) < y else 0), table.background_height - 1)
    return upper, lower, y - REAL(upper)


@inline
def _stretched(row, width, table, stretched):
    """The row of texels `row` as wide as the image: where it begins in the thread's memory."""
    texels, place = stretched.texels, (row & 1) * CHANNELS * width
    if stretched.index[row & 1] != row:
        background, stretch = table.background, table.stretch
        first = row * table.background_width
        for x in range(width):
            left = CHANNELS * (first + np.int64(stretch[x].left))
            right = CHANNELS * (first + np.int64(stretch[x].right))
            share = stretch[x].share
            red = background[left] * (ONE - share) + background[right] * share
            green = background[left + 1] * (ONE - share) + background[right + 1] * share
            blue = background[left + 2] * (ONE - share) + background[right + 2] * share
            flag = background[left + 3] * (ONE - share) + background[right + 3] * share
            texels[place + CHANNELS * x] = red
            texels[place + CHANNELS * x + 1] = green
            texels[place + CHANNELS * x + 2] = blue
            texels[place + CHANNELS * x + 3] = flag
        stretched.index[row & 1] = row
    return place


@inline
def draw_background(rays, begun, column, row, size, texel_rows, table, stretched, environment, pixels_at):
    """The background where nothing was met, unless it is there already, in sixteen pixels of a row from `column` on."""
    width = size[0]
    many, first = min(LANES, width - column), row * width + column
    pixels, channels = array_at(pixels_at, np.uint32), array_at(pixels_at + 4 * first, np.uint8)
    wanted = 0
    for lane in range(np.uint64(many)):
        there = pixels[first + np.int64(lane)] >> np.uint32(24) == np.uint32(BACKGROUND)
        met = begun & (rays.ball[lane] >= 0)
        wanted += select(there | met, np.int64(0), np.int64(1))
    if wanted == 0:
        return
    upper, lower, share = texel_rows
    above = below = np.int64(0)
    if environment:
        above = _stretched(upper, width, table, stretched) + CHANNELS * column
        below = _stretched(lower, width, table, stretched) + CHANNELS * column
    texels = stretched.texels
    if environment and wanted == LANES:
        for k in range(CHANNELS * LANES):
            value = texels[above + k] * (ONE - share) + texels[below + k] * share
            channels[k] = np.uint8(np.int32(value))
        return
    for lane in range(np.uint64(many)):
        n = np.int64(lane)
        if (begun and rays.ball[lane] >= 0) or pixels[first + n] >> np.uint32(24) == BACKGROUND:
            continue
        if not environment:
            pixels[first + n] = DARK_WORD
            continue
        for k in range(CHANNELS * n, CHANNELS * n + CHANNELS):
            value = texels[above + k] * (ONE - share) + texels[below + k] * share
            channels[k] = np.uint8(np.int32(value))
