"""The loop that drives ray batches through the stages, tile by tile (`queries` does so for single rays).

    regenerate -> closest -> surface -> draw -> material -> light -> BSDFs -> shade -> occluded -> add direct light -> finish

A lane that finishes its sample takes the next of the tile at once, from a second batch in which the camera has begun
sixteen samples together. A tile is rendered in passes of a few samples a pixel. A pass fills a buffer, which then goes to
the film in the order of samples: neither threads nor the way calls are split can change a bit of the image.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.values import call_stage, fetch_add, lowest_bit
from engines.kernels.lane.vector import Vec3, select3
from engines.kernels.layout import CAMERA_DIMENSIONS, LANES, VERTEX_DIMENSIONS, copy_path, ray_batch, waiting_rays

# places in the array of stage addresses; those of the scene's BSDF models come last
DRAW_PIXEL, BEGIN, CLOSEST, SURFACE, DRAW_VERTEX, LIGHT, SHADE, OCCLUDED, BARE_SURFACE, MATERIAL, FIRST_BSDF = range(11)
# places in the control array that threads share
STOP, NEXT_TILE, STACK_FULL = range(3)
EVERY_LANE = (1 << LANES) - 1

# totals of a thread
RAYS, BAD_SAMPLES = 0, 1


@inline
def make_idle(rays, lane, sample):
    """A lane without work still runs through the stages: give it a ray that is not traced. Stages look up tables
    by sample, dimension (which follows from the depth) and light, so all of them must exist."""
    rays.alive[lane] = False
    rays.sample[lane] = sample
    rays.dimension[lane] = 0
    rays.depth[lane] = 1
    rays.light[lane] = 0
    rays.done[lane] = False
    rays.t[lane] = -1.0
    rays.shadow_t_max[lane] = -1.0
    rays.held_primitive[lane] = -1


@inline
def _add_direct_light(rays, zero):
    """Adds the light samples that nothing hides."""
    for lane in range(np.uint64(LANES)):
        direct = select3(rays.occluded[lane] != 0, Vec3(zero, zero, zero), rays.direct[lane])
        rays.radiance[lane] = rays.radiance[lane] + direct


@inline
def _push(rays, stacks, lane, capacity):
    """Puts the second ray of a hit on the lane's stack; returns whether there was room."""
    waiting = rays.waiting[lane]
    if waiting >= capacity:
        return False
    top = stacks[waiting]
    top.origin[lane] = rays.branch_origin[lane]
    top.direction[lane] = rays.branch_direction[lane]
    top.throughput[lane] = rays.branch_throughput[lane]
    top.depth[lane] = rays.depth[lane]
    top.origin_primitive[lane] = rays.origin_primitive[lane]
    rays.waiting[lane] = waiting + 1
    return True


@inline
def _pop(rays, stacks, lane, per_vertex):
    """Takes up the ray that waits on the lane's stack."""
    waiting = rays.waiting[lane] - 1
    top = stacks[waiting]
    rays.origin[lane] = top.origin[lane]
    rays.direction[lane] = top.direction[lane]
    rays.throughput[lane] = top.throughput[lane]
    depth = top.depth[lane]
    rays.depth[lane] = depth
    rays.origin_primitive[lane] = top.origin_primitive[lane]
    rays.dimension[lane] = CAMERA_DIMENSIONS + VERTEX_DIMENSIONS * (depth - 1) * per_vertex
    rays.t[lane] = math.inf
    rays.waiting[lane] = waiting


class Pass(NamedTuple):
    """What a tile has to do: a rectangle of pixels, and samples first .. first + samples - 1 of each."""

    x0: int
    y0: int
    columns: int
    rows: int
    width: int
    first: int
    samples: int


class Plan(NamedTuple):
    """Which stages the driver calls for the scene and its integrator."""

    lit: bool
    """There are lights to sample."""
    shadows: bool
    branches: bool
    """Two rays may follow from one hit."""
    per_vertex: int
    """Light samples at a vertex."""
    bsdfs: int
    """Stages of BSDF models, where the scene has several."""
    programs: bool
    """Some material has wrappers or textures."""


class Issued(NamedTuple):
    """Samples of a pass that have begun, where the next one lies in the tile, and how many wait for a lane."""

    count: int
    column: int
    row: int
    sample: int
    waiting: int


@inline
def _begin(stages, spare, scene, begun, work, issued):
    """Begins up to sixteen samples in the spare batch."""
    count, column, row, sample = issued.count, issued.column, issued.row, issued.sample
    waiting = min(np.int64(LANES), work.samples * work.columns * work.rows - count)
    for k in range(waiting, LANES):
        make_idle(begun, np.uint64(k), work.first)
    for k in range(waiting):
        lane = np.uint64(k)
        begun.slot[lane] = count + k
        begun.pixel[lane] = (work.y0 + row) * work.width + work.x0 + column
        begun.pixel_x[lane] = work.x0 + column
        begun.pixel_y[lane] = work.y0 + row
        begun.sample[lane] = work.first + sample
        begun.dimension[lane] = 0
        column += 1
        if column == work.columns:
            column = 0
            row += 1
            if row == work.rows:
                row = 0
                sample += 1
    call_stage(stages[DRAW_PIXEL], spare, scene)
    call_stage(stages[BEGIN], spare, scene)
    return Issued(count + waiting, column, row, sample, waiting)


@inline
def _lanes_with(flags):
    """A word with a bit for each lane whose flag is set."""
    bits = np.int64(0)
    for lane in range(np.uint64(LANES)):
        bits |= np.int64(1 if flags[lane] else 0) << np.int64(lane)
    return bits


@inline
def _regenerate(stages, batch, spare, scene, real, work, issued, free):
    """Gives a sample to each lane of the word `free`; returns what is issued now, and the lanes that stay without."""
    rays, begun = ray_batch(batch, real), ray_batch(spare, real)
    idle = np.int64(0)
    while free != 0:
        lane = np.uint64(lowest_bit(free))
        free &= free - 1
        if issued.waiting == 0 and issued.count < work.samples * work.columns * work.rows:
            issued = _begin(stages, spare, scene, begun, work, issued)
        if issued.waiting == 0:
            make_idle(rays, lane, work.first)
            idle |= np.int64(1) << np.int64(lane)
            continue
        from_lane = np.uint64((issued.count - issued.waiting) % LANES)
        copy_path(batch, lane, spare, from_lane, real)
        issued = Issued(issued.count, issued.column, issued.row, issued.sample, issued.waiting - 1)
    return issued, idle


@inline
def _count_rays(t_max, zero):
    """How many lanes have a ray to be traced: one whose `t_max` is above 0."""
    n = 0
    for lane in range(np.uint64(LANES)):
        n += 1 if t_max[lane] > zero else 0
    return n


@inline
def _advance(rays, stages, batch, scene, plan, zero):
    """One segment of every path; returns the rays that were traced."""
    traced = _count_rays(rays.t, zero)
    call_stage(stages[CLOSEST], batch, scene)
    call_stage(stages[SURFACE], batch, scene)
    call_stage(stages[DRAW_VERTEX], batch, scene)
    if plan.programs:
        call_stage(stages[MATERIAL], batch, scene)
    if plan.lit:
        call_stage(stages[LIGHT], batch, scene)
    for k in range(plan.bsdfs):
        call_stage(stages[FIRST_BSDF + k], batch, scene)
    call_stage(stages[SHADE], batch, scene)
    if plan.lit:
        if plan.shadows:
            traced += _count_rays(rays.shadow_t_max, zero)
            call_stage(stages[OCCLUDED], batch, scene)
        _add_direct_light(rays, zero)
    return traced


@inline
def _finish(rays, stacks, capacity, plan, buffer):
    """Lanes whose path has ended hand in their radiance, or take up a ray that waits; returns those that are free, and
    whether every second ray found room on its stack."""
    fits = True
    if plan.branches:
        for lane in range(np.uint64(LANES)):
            if rays.branch[lane]:
                fits &= _push(rays, stacks, lane, capacity)
    done, free = _lanes_with(rays.done), np.int64(0)
    while done != 0:
        lane = np.uint64(lowest_bit(done))
        done &= done - 1
        if plan.branches and rays.waiting[lane] > 0:
            _pop(rays, stacks, lane, plan.per_vertex)
            continue
        slot, radiance = rays.slot[lane], rays.radiance[lane]
        buffer[slot, 0], buffer[slot, 1], buffer[slot, 2] = radiance.x, radiance.y, radiance.z
        free |= np.int64(1) << np.int64(lane)
    return free, fits


@cache
def driver(real: Any) -> Any:
    """The kernel that one thread runs: takes tiles until there are none, or until `control[STOP]` is set."""
    zero = real(0)

    def drive(
        stages, batch, spare, stack, capacity, scene, plan, tiles, done, target, chunk, width, control,
        sums, squares, even_sums, counts, buffer, totals,
    ):  # fmt: skip
        rays, stacks = ray_batch(batch, real), waiting_rays(stack, real)
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
                    issued, idle_now = _regenerate(stages, batch, spare, scene, real, work, issued, free)
                    idle |= idle_now
                    if idle == EVERY_LANE:
                        break
                    totals[RAYS] += _advance(rays, stages, batch, scene, plan, zero)
                    free, fits = _finish(rays, stacks, capacity, plan, buffer)
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
