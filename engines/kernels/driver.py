"""The loop that drives ray batches through the stages, tile by tile (`queries` does so for single rays).

    regenerate -> closest -> surface -> (draw -> material -> sampling -> shade -> occluded -> add direct light) -> finish

Integrators that visit all lights repeat what stands in brackets for each light; the material is looked up once. `pipeline` has
the table of stages.

Where shadow rays cross null lobes, they have a third batch, in which closest, surface and transmit take the place of occluded.

A lane that finishes its sample takes the next of the tile at once: from its lane of a second batch, in which the camera
begins samples together. Where all lanes finish at once, samples begin in the batch itself. A tile is rendered in passes of a
few samples per pixel. A pass fills a buffer, which then goes to the film in the order of samples: neither threads nor the way
calls are split can change a bit of the image.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.masks import EVERY_LANE, flagged_lanes, lanes_where, positive_lanes
from engines.kernels.compile.values import bits_set, call_stage, fetch_add, highest_bit, lowest_bit, select
from engines.kernels.guide_records import keep_records, learn
from engines.kernels.lane.vector import BLACK, WHITE
from engines.kernels.layout import (
    CAMERA_DIMENSIONS,
    LANES,
    MISS,
    MOST_NULL_LOBES,
    VERTEX_DIMENSIONS,
    copy_paths,
    ray_batch,
    waiting_rays,
)

# places in the control array that threads share
STOP, NEXT_TILE, STACK_FULL = range(3)

# totals of a thread
RAYS, BAD_SAMPLES = 0, 1

TILE = 32
"""Pixels a side. A tile's last lanes run half empty, so tiles are not small; a hundred of them keep threads busy."""


def tiles(width: int, height: int) -> NDArray[np.int32]:
    """(n, 4) x, y, columns, rows of the tiles that cover an image."""
    places = [(x, y) for y in range(0, height, TILE) for x in range(0, width, TILE)]
    return np.array([(x, y, min(TILE, width - x), min(TILE, height - y)) for x, y in places], np.int32)


_from_zero = lanes_where(">=", 0)


@inline
def make_idle(rays, lane, sample):
    """A lane without work still runs through the stages: give it a ray that is not traced. Stages look up tables
    by sample and dimension, so both must exist."""
    rays.alive[lane] = False
    rays.sample[lane] = sample
    rays.dimension[lane] = 0
    rays.path.depth[lane] = 1
    rays.done[lane] = False
    rays.t[lane] = -1.0
    rays.shadow.t_max[lane] = -1.0


@inline
def _add_direct_light(rays, tested):
    """Adds the light samples that nothing hides; `tested`: there were shadow rays."""
    for lane in range(np.uint64(LANES)):
        direct = select(tested & (rays.shadow.occluded[lane] != 0), BLACK, rays.shadow.direct[lane])
        rays.radiance[lane] = rays.radiance[lane] + direct


@inline
def _push(rays, stacks, lane, capacity):
    """Puts the second ray of a hit on the lane's stack; returns whether there was room. It follows shade, which has given the
    lane the depth and `origin_primitive` that both rays share."""
    waiting = rays.waiting[lane]
    if waiting >= capacity:
        return False
    top = stacks[waiting]
    top.origin[lane] = rays.branch.origin[lane]
    top.direction[lane] = rays.branch.direction[lane]
    top.throughput[lane] = rays.branch.throughput[lane]
    top.depth[lane] = rays.path.depth[lane]
    top.origin_primitive[lane] = rays.origin_primitive[lane]
    top.origin_instance[lane] = rays.origin_instance[lane]
    rays.waiting[lane] = waiting + 1
    return True


@inline
def _pop(rays, stacks, lane, per_vertex):
    """Takes up the ray that waits on the lane's stack."""
    waiting = rays.waiting[lane] - 1
    top = stacks[waiting]
    rays.origin[lane] = top.origin[lane]
    rays.direction[lane] = top.direction[lane]
    rays.path.throughput[lane] = top.throughput[lane]
    rays.path.pdf[lane] = math.inf
    depth = top.depth[lane]
    rays.path.depth[lane] = depth
    rays.origin_primitive[lane] = top.origin_primitive[lane]
    rays.origin_instance[lane] = top.origin_instance[lane]
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


class Memory(NamedTuple):
    """Addresses of a thread's memory."""

    batch: int
    spare: int
    """The batch in which samples begin."""
    shadows: int
    """The batch of shadow rays, where these cross null lobes."""
    stack: int
    capacity: int
    """Rays that may wait on the stack of a lane."""


class FilmArrays(NamedTuple):
    """The arrays of a film, flat: three numbers a pixel, of `counts` one."""

    sums: Any
    squares: Any
    even_sums: Any
    counts: Any


class Issued(NamedTuple):
    """Samples of a pass that have begun, and the lanes in which one waits, begun in the spare batch."""

    count: int
    ready: int


@inline
def _place(rays, work, count, lanes, real):
    """Gives the lanes of the word `lanes` the samples from number `count` of the pass on, in order, and the last one again
    where there are no more."""
    last = np.int32(work.samples * work.rows * work.columns - 1)
    columns, pixels = np.int32(work.columns), np.int32(work.rows * work.columns)
    row_share, pass_share = np.float32(1.0) / np.float32(columns), np.float32(1.0) / np.float32(pixels)
    for lane in range(np.uint64(LANES)):
        bit = np.int32(1) << np.int32(lane)
        number = np.int32(np.int32(count) + bits_set(np.int32(lanes) & np.int32(bit - np.int32(1))))
        number = select(number < last, number, last)
        # whole quotients are exact: a pass has some thousand samples, and the half keeps quotients off whole numbers
        sample = np.int32((np.float32(number) + np.float32(0.5)) * pass_share)
        place = np.int32(number - np.int32(sample * pixels))
        row = np.int32((np.float32(place) + np.float32(0.5)) * row_share)
        x, y = np.int32(np.int32(work.x0) + place - row * columns), np.int32(np.int32(work.y0) + row)
        fresh = np.int32(lanes) & bit != 0
        rays.slot[lane] = select(fresh, number, np.int32(rays.slot[lane]))
        rays.pixel[lane] = select(fresh, np.int32(y * np.int32(work.width) + x), np.int32(rays.pixel[lane]))
        rays.pixel_x[lane] = select(fresh, real(x), rays.pixel_x[lane])
        rays.pixel_y[lane] = select(fresh, real(y), rays.pixel_y[lane])
        rays.sample[lane] = select(fresh, np.int32(work.first + sample), np.int32(rays.sample[lane]))
        rays.dimension[lane] = 0


@inline
def _make_idle(rays, lanes, sample):
    while lanes != 0:
        make_idle(rays, np.uint64(lowest_bit(lanes)), sample)
        lanes &= lanes - 1


@inline
def _begin(stages, batch, scene, work, count, lanes, real):
    """Begins samples from number `count` of the pass on in the lanes of the word `lanes`; returns the lanes in which one has
    begun. Lanes that are not in the word begin their sample anew."""
    rays = ray_batch(batch, real)
    _place(rays, work, count, lanes, real)
    call_stage(stages.draw_pixel, batch, scene)
    call_stage(stages.camera, batch, scene)
    surplus, left = np.int64(0), work.samples * work.rows * work.columns - count
    while bits_set(lanes) > left:
        bit = np.int64(1) << highest_bit(lanes)
        surplus |= bit
        lanes &= ~bit
    _make_idle(rays, surplus, work.first)
    return lanes


@inline
def _regenerate(stages, batch, spare, scene, real, work, issued, free):
    """Gives a sample to each lane of the word `free`; returns what is issued now, and the lanes that stay without."""
    count, ready = issued.count, issued.ready
    some_left = count < work.samples * work.rows * work.columns
    if some_left and free == EVERY_LANE and ready == 0:
        taken = _begin(stages, batch, scene, work, count, free, real)
        return Issued(count + bits_set(taken), ready), free & ~taken
    if some_left and free & ~ready != 0:
        begun = _begin(stages, spare, scene, work, count, EVERY_LANE & ~ready, real)
        count, ready = count + bits_set(begun), ready | begun
    if free & ready != 0:
        copy_paths(batch, spare, free & ready, real)
    idle = free & ~ready
    _make_idle(ray_batch(batch, real), idle, work.first)
    return Issued(count, ready & ~free), idle


@inline
def _some_scatter(rays, last_depth):
    """Whether some lane needs random numbers, a light sample and its BSDF."""
    lanes = np.int32(0)
    for lane in range(np.uint64(LANES)):
        scatters = rays.alive[lane] & (rays.hit.kind[lane] != MISS) & (np.int32(rays.path.depth[lane]) < last_depth)
        lanes |= np.int32(1 if scatters else 0)
    return lanes != 0


@inline
def _cross_null_lobes(rays, stages, shadows, scene, media, real):
    """Multiplies the light samples by what null lobes let pass on their way; returns the rays that were traced."""
    walk, traced = ray_batch(shadows, real), 0
    for lane in range(np.uint64(LANES)):
        walk.origin[lane] = rays.shadow.origin[lane]
        walk.direction[lane] = rays.shadow.direction[lane]
        walk.t[lane] = rays.shadow.t_max[lane]
        walk.shadow.t_max[lane] = rays.shadow.t_max[lane]
        walk.shadow.destination[lane] = rays.shadow.destination[lane]
        walk.origin_primitive[lane] = rays.origin_primitive[lane]
        walk.origin_instance[lane] = rays.origin_instance[lane]
        walk.shadow.transmittance[lane] = WHITE
    if media:
        for lane in range(np.uint64(LANES)):
            walk.attenuation[lane] = rays.attenuation[lane]
    for _ in range(MOST_NULL_LOBES):
        lanes = positive_lanes(walk.t)
        if lanes == 0:
            break
        traced += bits_set(lanes)
        call_stage(stages.closest, shadows, scene)
        call_stage(stages.dark_surface, shadows, scene)
        call_stage(stages.transmit, shadows, scene)
    for lane in range(np.uint64(LANES)):
        passed = select(walk.t[lane] > 0.0, BLACK, walk.shadow.transmittance[lane])
        rays.shadow.direct[lane] = rays.shadow.direct[lane] * passed
        rays.shadow.occluded[lane] = 0
    return traced


@inline
def _trace_shadow_rays(rays, stages, batch, shadows, scene, plan, real):
    """Adds the light samples that nothing hides; returns the rays that were traced."""
    traced, lanes = 0, positive_lanes(rays.shadow.t_max)
    if lanes != 0 and plan.null_lobes:
        traced = _cross_null_lobes(rays, stages, shadows, scene, plan.media, real)
    elif lanes != 0:
        traced = bits_set(lanes)
        if stages.attenuation != 0:
            call_stage(stages.attenuation, batch, scene)
        call_stage(stages.occluded, batch, scene)
    # where no ray is sent, light of sources that touch the surface may be left
    _add_direct_light(rays, lanes != 0)
    return traced


@inline
def _advance(rays, stages, batch, shadows, scene, plan, records, real):
    """One segment of every path; returns the rays that were traced."""
    traced = bits_set(positive_lanes(rays.t))
    if plan.media:
        call_stage(stages.draw_flight, batch, scene)
        call_stage(stages.flight, batch, scene)
    call_stage(stages.closest, batch, scene)
    call_stage(stages.surface, batch, scene)
    if plan.media:
        call_stage(stages.arrival, batch, scene)
    scatters = plan.last_depth == 0 or _some_scatter(rays, np.int32(plan.last_depth))
    for k in range(plan.per_vertex):
        for lane in range(np.uint64(LANES)):
            rays.light_index[lane] = k
        if scatters:
            call_stage(stages.draw_vertex, batch, scene)
            if k == 0 and stages.material != 0:
                call_stage(stages.material, batch, scene)
            for stage in stages.sampling:
                call_stage(stage, batch, scene)
        call_stage(stages.shade, batch, scene)
        if plan.lit:
            traced += _trace_shadow_rays(rays, stages, batch, shadows, scene, plan, real)
    if plan.guided and scatters:
        keep_records(rays, _from_zero(rays.recorded.vertex), records)
    return traced


@inline
def _finish(rays, stacks, capacity, plan, buffer):
    """Lanes whose path has ended hand in their radiance, or take up a ray that waits; returns those that are free, and
    whether every second ray found room on its stack."""
    fits = True
    if plan.branches:
        for lane in range(np.uint64(LANES)):
            if rays.branch.there[lane]:
                fits &= _push(rays, stacks, lane, capacity)
    done, free = flagged_lanes(rays.done), np.int64(0)
    while done != 0:
        lane = np.uint64(lowest_bit(done))
        done &= done - 1
        if plan.branches and rays.waiting[lane] > 0:
            _pop(rays, stacks, lane, plan.per_vertex)
            continue
        start, radiance = np.uint64(3 * np.int64(rays.slot[lane])), rays.radiance[lane]
        buffer[start], buffer[start + np.uint64(1)], buffer[start + np.uint64(2)] = radiance.x, radiance.y, radiance.z
        free |= np.int64(1) << np.int64(lane)
    return free, fits


@cache
def driver(real: Any) -> Any:
    """The kernel that one thread runs: takes tiles until there are none, or until `control[STOP]` is set."""

    def drive(stages, plan, scene, memory, tiles, done, target, chunk, width, control, film, buffer, records, totals):
        batch, rays, stacks = memory.batch, ray_batch(memory.batch, real), waiting_rays(memory.stack, real)
        next_tile, traced = control.ctypes.data + 8 * NEXT_TILE, 0
        while True:
            tile = fetch_add(next_tile, 1)
            if tile >= len(tiles):
                totals[RAYS] += traced  # not every batch: threads would wait for each other's cache lines
                return
            while done[tile] < target:
                first = done[tile]
                x0, y0, columns, rows = tiles[tile, 0], tiles[tile, 1], tiles[tile, 2], tiles[tile, 3]
                work = Pass(x0, y0, columns, rows, width, first, min(chunk, target - first))
                issued, free, idle = Issued(0, 0), np.int64(EVERY_LANE), np.int64(0)
                while True:
                    if control[STOP] != 0 or control[STACK_FULL] != 0:
                        totals[RAYS] += traced
                        return  # what this pass has gathered is dropped: the film holds whole passes
                    issued, idle_now = _regenerate(stages, batch, memory.spare, scene, real, work, issued, free)
                    idle |= idle_now
                    if idle == EVERY_LANE:
                        break
                    traced += _advance(rays, stages, batch, memory.shadows, scene, plan, records, real)
                    free, fits = _finish(rays, stacks, memory.capacity, plan, buffer)
                    if not fits:
                        control[STACK_FULL] = 1
                if plan.guided:
                    learn(work.samples * work.rows * work.columns, records, buffer)
                _commit(buffer, work, film, totals)
                done[tile] = first + work.samples

    return kernel(drive)


@inline
def _blacken(buffer, numbers):
    """Sets samples of which a number is not finite to black; returns how many there are."""
    bad, infinite = 0, buffer.dtype.type(np.inf)
    for k in range(np.uint64(numbers)):
        bad += 0 if abs(buffer[k]) < infinite else 1
    if bad == 0:
        return 0
    bad = 0
    for start in range(0, numbers, 3):
        whole = math.isfinite(buffer[start]) and math.isfinite(buffer[start + 1]) and math.isfinite(buffer[start + 2])
        if not whole:
            buffer[start], buffer[start + 1], buffer[start + 2] = 0.0, 0.0, 0.0
            bad += 1
    return bad


@inline
def _commit(buffer, work, film, totals):
    """Adds a finished pass of a tile to the film, samples in order; a sample that is not finite counts as black."""
    numbers = 3 * work.columns
    totals[BAD_SAMPLES] += _blacken(buffer, work.samples * work.rows * numbers)
    for row in range(work.rows):
        pixel = (work.y0 + row) * work.width + work.x0
        for sample in range(work.samples):
            source, target = np.uint64((sample * work.rows + row) * numbers), np.uint64(3 * pixel)
            for k in range(np.uint64(numbers)):
                value = np.float64(buffer[source + k])
                film.sums[target + k] += value
                film.squares[target + k] += value * value
            if (work.first + sample) % 2 == 0:
                for k in range(np.uint64(numbers)):
                    film.even_sums[target + k] += np.float64(buffer[source + k])
        for column in range(np.uint64(work.columns)):
            film.counts[np.uint64(pixel) + column] += work.samples
