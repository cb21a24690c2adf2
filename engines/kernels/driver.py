"""The loop that drives blocks of lanes through the stages, tile by tile (`queries` does so for single rays).

    refill -> closest -> surface -> draw -> light -> shade -> occluded -> settle -> retire

A lane that finishes its sample takes the next of the tile at once, from a second block in which the camera has begun
sixteen samples together. A tile is rendered in passes of a few samples a pixel. A pass fills a buffer, which then goes to
the film in the order of samples: neither threads nor the way calls are split can change a bit of the image.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels.block import STACK_FIELDS
from engines.kernels.jit import (
    LANES,
    call_stage,
    fetch_add,
    get,
    get_int,
    inline,
    kernel,
    lowest_bit,
    pointer,
    put,
    put_int,
)
from engines.kernels.vector import Vec3, select3

# places in the array of stage addresses
DRAW_PIXEL, BEGIN, CLOSEST, SURFACE, DRAW_VERTEX, LIGHT, SHADE, OCCLUDED, BARE_SURFACE = range(9)
# places in the control array that threads share
STOP, NEXT_TILE, STACK_FULL = range(3)
EVERY_LANE = (1 << LANES) - 1

# totals of a thread
RAYS, BAD_SAMPLES = 0, 1


@inline
def make_idle(lanes, lane, one, sample):
    """A lane without work still runs through the stages: give it a harmless ray that is not traced. Stages look up tables
    by sample, dimension (which follows from the depth) and light, so all of them must exist."""
    put_int(lanes, at.ALIVE, lane, 0)
    put_int(lanes, at.SAMPLE, lane, sample)
    put_int(lanes, at.DIMENSION, lane, 0)
    put_int(lanes, at.DEPTH, lane, 1)
    put_int(lanes, at.LIGHT, lane, 0)
    put_int(lanes, at.DONE, lane, 0)
    put(lanes, at.T, lane, -one)
    put(lanes, at.SHADOW_T, lane, -one)
    put_int(lanes, at.HELD, lane, -1)


@inline
def _settle(lanes, zero):
    """Adds the light samples that nothing hides."""
    for lane in range(np.uint64(LANES)):
        hidden = get_int(lanes, at.OCCLUDED, lane) != 0
        direct = select3(hidden, Vec3(zero, zero, zero), at.get3(lanes, at.DIRECT, lane))
        at.put3(lanes, at.RADIANCE, lane, at.get3(lanes, at.RADIANCE, lane) + direct)


@inline
def _push(lanes, stacks, lane, capacity):
    """Puts the second ray of a hit on the lane's stack; returns whether there was room."""
    waiting = get_int(lanes, at.STACK, lane)
    if waiting >= capacity:
        return False
    place = waiting * STACK_FIELDS
    at.put3(stacks, place, lane, at.get3(lanes, at.SHADOW_ORIGIN, lane))
    at.put3(stacks, place + 3, lane, at.get3(lanes, at.BRANCH_DIRECTION, lane))
    at.put3(stacks, place + 6, lane, at.get3(lanes, at.BRANCH_THROUGHPUT, lane))
    put_int(stacks, place + 9, lane, get_int(lanes, at.DEPTH, lane))
    put_int(stacks, place + 10, lane, get_int(lanes, at.LEFT, lane))
    put_int(lanes, at.STACK, lane, waiting + 1)
    return True


@inline
def _pop(lanes, stacks, lane, one, turns):
    """Takes up the ray that waits on the lane's stack."""
    waiting = get_int(lanes, at.STACK, lane) - 1
    place = waiting * STACK_FIELDS
    at.put3(lanes, at.ORIGIN, lane, at.get3(stacks, place, lane))
    at.put3(lanes, at.DIRECTION, lane, at.get3(stacks, place + 3, lane))
    at.put3(lanes, at.THROUGHPUT, lane, at.get3(stacks, place + 6, lane))
    depth = get_int(stacks, place + 9, lane)
    put_int(lanes, at.DEPTH, lane, depth)
    put_int(lanes, at.LEFT, lane, get_int(stacks, place + 10, lane))
    put_int(lanes, at.DIMENSION, lane, 2 + 8 * (depth - 1) * turns)
    put(lanes, at.T, lane, one * math.inf)
    put_int(lanes, at.STACK, lane, waiting)


class Pass(NamedTuple):
    """What a tile has to do: a rectangle of pixels, and samples first .. first + samples - 1 of each."""

    x0: int
    y0: int
    columns: int
    rows: int
    width: int
    first: int
    samples: int


class Rule(NamedTuple):
    """What the scene and its shader ask of the driver."""

    lit: bool
    """There are lights to sample."""
    shadows: bool
    branches: bool
    """Two rays may follow from one hit."""
    turns: int
    """Light samples at a vertex."""


class Issued(NamedTuple):
    """Samples of a pass that have begun, where the next one lies in the tile, and how many wait for a lane."""

    count: int
    column: int
    row: int
    sample: int
    waiting: int


@inline
def _begin(stages, spare, world, lanes, work, issued, one):
    """Begins up to sixteen samples in the spare block."""
    count, column, row, sample = issued.count, issued.column, issued.row, issued.sample
    waiting = min(np.int64(LANES), work.samples * work.columns * work.rows - count)
    for k in range(waiting, LANES):
        make_idle(lanes, np.uint64(k), one, work.first)
    for k in range(waiting):
        lane = np.uint64(k)
        put_int(lanes, at.SLOT, lane, count + k)
        put_int(lanes, at.PIXEL, lane, (work.y0 + row) * work.width + work.x0 + column)
        put(lanes, at.COLUMN, lane, one * (work.x0 + column))
        put(lanes, at.ROW, lane, one * (work.y0 + row))
        put_int(lanes, at.SAMPLE, lane, work.first + sample)
        put_int(lanes, at.DIMENSION, lane, 0)
        column += 1
        if column == work.columns:
            column = 0
            row += 1
            if row == work.rows:
                row = 0
                sample += 1
    call_stage(stages[DRAW_PIXEL], spare, world)
    call_stage(stages[BEGIN], spare, world)
    return Issued(count + waiting, column, row, sample, waiting)


@inline
def _lanes_with(lanes, field):
    """A word with a bit for each lane whose integer in `field` is not 0."""
    bits = np.int64(0)
    for lane in range(np.uint64(LANES)):
        bits |= np.int64(1 if get_int(lanes, field, lane) != 0 else 0) << np.int64(lane)
    return bits


@inline
def _refill(stages, block, spare, world, real, work, issued, free):
    """Gives a sample to each lane of the word `free`; returns what is issued now, and the lanes that stay without."""
    lanes, begun, one = pointer(block, real), pointer(spare, real), real(1)
    idle = np.int64(0)
    while free != 0:
        lane = np.uint64(lowest_bit(free))
        free &= free - 1
        if issued.waiting == 0 and issued.count < work.samples * work.columns * work.rows:
            issued = _begin(stages, spare, world, begun, work, issued, one)
        if issued.waiting == 0:
            make_idle(lanes, lane, one, work.first)
            idle |= np.int64(1) << np.int64(lane)
            continue
        from_lane = np.uint64((issued.count - issued.waiting) % LANES)
        for field in range(at.JOB_FIRST, at.JOB_LAST):
            put(lanes, field, lane, get(begun, field, from_lane))
        issued = Issued(issued.count, issued.column, issued.row, issued.sample, issued.waiting - 1)
    return issued, idle


@inline
def _rays_of(lanes, reach, zero):
    """How many lanes have a ray to be traced: one whose `reach` is above 0."""
    rays = 0
    for lane in range(np.uint64(LANES)):
        rays += 1 if get(lanes, reach, lane) > zero else 0
    return rays


@inline
def _advance(lanes, stages, block, world, rule, zero):
    """One segment of every path; returns the rays that were traced."""
    rays = _rays_of(lanes, at.T, zero)
    call_stage(stages[CLOSEST], block, world)
    call_stage(stages[SURFACE], block, world)
    call_stage(stages[DRAW_VERTEX], block, world)
    if rule.lit:
        call_stage(stages[LIGHT], block, world)
    call_stage(stages[SHADE], block, world)
    if rule.lit:
        if rule.shadows:
            rays += _rays_of(lanes, at.SHADOW_T, zero)
            call_stage(stages[OCCLUDED], block, world)
        _settle(lanes, zero)
    return rays


@inline
def _retire(lanes, stacks, capacity, rule, buffer, one):
    """Lanes whose path has ended hand in their radiance, or take up a ray that waits; returns those that are free, and
    whether every second ray found room on its stack."""
    fits = True
    if rule.branches:
        for lane in range(np.uint64(LANES)):
            if get_int(lanes, at.BRANCH, lane) != 0:
                fits &= _push(lanes, stacks, lane, capacity)
    done, free = _lanes_with(lanes, at.DONE), np.int64(0)
    while done != 0:
        lane = np.uint64(lowest_bit(done))
        done &= done - 1
        if rule.branches and get_int(lanes, at.STACK, lane) > 0:
            _pop(lanes, stacks, lane, one, rule.turns)
            continue
        slot = get_int(lanes, at.SLOT, lane)
        for channel in range(3):
            buffer[slot, channel] = get(lanes, at.RADIANCE + channel, lane)
        free |= np.int64(1) << np.int64(lane)
    return free, fits


@cache
def driver(real: Any) -> Any:
    """The kernel that one thread runs: pulls tiles until there are none, or until it is told to stop."""
    one, zero = real(1), real(0)

    def drive(
        stages, block, spare, stack, capacity, world, rule, tiles, done, target, chunk, width, control,
        sums, squares, even_sums, counts, buffer, totals,
    ):  # fmt: skip
        lanes, stacks = pointer(block, real), pointer(stack, real)
        next_tile = control.ctypes.data + 8 * NEXT_TILE
        while True:
            tile = fetch_add(next_tile, 1)
            if tile >= len(tiles):
                return
            while done[tile] < target:
                first = done[tile]
                x0, y0, columns, rows = tiles[tile, 0], tiles[tile, 1], tiles[tile, 2], tiles[tile, 3]
                work = Pass(x0, y0, columns, rows, width, first, min(chunk, target - first))
                issued, free, idle = Issued(0, 0, 0, 0, 0), EVERY_LANE, np.int64(0)
                while True:
                    if control[STOP] != 0 or control[STACK_FULL] != 0:
                        return  # what this pass has gathered is dropped: the film holds whole passes
                    issued, idle_now = _refill(stages, block, spare, world, real, work, issued, free)
                    idle |= idle_now
                    if idle == EVERY_LANE:
                        break
                    totals[RAYS] += _advance(lanes, stages, block, world, rule, zero)
                    free, fits = _retire(lanes, stacks, capacity, rule, buffer, one)
                    if not fits:
                        control[STACK_FULL] = 1
                _commit(buffer, work, sums, squares, even_sums, counts, totals)
                done[tile] = first + work.samples

    return kernel(drive)


@inline
def _commit(buffer, work, sums, squares, even_sums, counts, totals):
    """Adds a finished pass of a tile to the film, samples in order; a sample that is not finite counts as black."""
    slot = 0
    for sample in range(work.samples):
        even = (work.first + sample) % 2 == 0
        for row in range(work.rows):
            for column in range(work.columns):
                pixel = (work.y0 + row) * work.width + work.x0 + column
                r, g, b = np.float64(buffer[slot, 0]), np.float64(buffer[slot, 1]), np.float64(buffer[slot, 2])
                slot += 1
                if not (math.isfinite(r) and math.isfinite(g) and math.isfinite(b)):
                    totals[BAD_SAMPLES] += 1
                    r, g, b = 0.0, 0.0, 0.0
                sums[pixel, 0] += r
                sums[pixel, 1] += g
                sums[pixel, 2] += b
                squares[pixel, 0] += r * r
                squares[pixel, 1] += g * g
                squares[pixel, 2] += b * b
                if even:
                    even_sums[pixel, 0] += r
                    even_sums[pixel, 1] += g
                    even_sums[pixel, 2] += b
                counts[pixel] += 1
