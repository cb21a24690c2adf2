"""Growing a two-wide tree over boxes by the surface area heuristic, without recursion, by all threads: planes between bins
of boxes (Wald 2007), between any two of few, and where halves would overlap planes that cut triangles in two (Stich, Friedrich
and Dietrich 2009).

A box is eight float32 numbers, its lower and its negated upper corner with a spare beside each, so that one vector
minimum joins two, and a box of inf is empty. A *part* is a box of a primitive, or of what lies of it between planes. A node is
a box and a link (start, count, split): it holds the parts order[start : start + count], and unless split is 0 its halves are
the nodes `split` and `split` + 1. A node's parts lie in a window [first, end) of places, which has room for those that planes
add; its tree owns the places 2 first + 2 .. 2 end - 1 of nodes, so the nodes lie in the same places whichever thread puts them
there, and in whatever order.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.simd import convert, lane, lesser, load8, splat, store8, swapped
from engines.kernels.compile.values import select
from engines.numba_cpu.accel.bvh_cuts import (
    CUT_SCRATCH,
    NO_PLANE,
    Copy,
    Plane,
    Window,
    better_plane,
    find_cut,
    half_area,
    move_cut,
    put,
)

BINS, SWEPT = 32, 64
"""At most: bins of boxes; parts of which every plane between two is looked at, not those of bins alone."""
LEAF = 8
"""Primitives a leaf may hold, all of one kind."""
DEEPEST = 48
"""Below this depth nodes are halved by count, which bounds the depth by DEEPEST + log2(n) + 1, of n parts."""
TASK = 4096
"""Up to so many parts are one task; what holds more is divided by a task of its own, up to 64 of them."""
OVERLAP = 1e-3
"""Planes that cut are looked at where the halves of a node would have this share of the scene's area in common."""
SEARCH = max(10 * 3 * BINS + 16, 5 * SWEPT)
"""Numbers that the search for a plane between parts works on."""
SCRATCH = SEARCH + CUT_SCRATCH
TRIANGLES, SPHERES, ANALYTIC, INSTANCES = range(4)
"""Kinds of primitives, in the order in which they are numbered. A leaf holds one instance."""


class Firsts(NamedTuple):
    """The numbers of the first sphere, of the first analytic shape and of the first instance."""

    sphere: int
    analytic: int
    instance: int


class Growth(NamedTuple):
    """Of n places: `records` (2, n, 8) float32 boxes and `order` (2, n) int32: each division moves parts from one copy to the
    other. `boxes` (2n, 8) float32 and `links` (2n, 3) int32: the tree. `bins`, `swept` and `fewest` are those of
    `bvh.Quality`. Boxes are in multiples of `unit`, triangles in metres; boxes of parts are padded by `pad`, and by the share
    `rounding` of each number."""

    records: NDArray[np.float32]
    order: NDArray[np.int32]
    boxes: NDArray[np.float32]
    links: NDArray[np.int32]
    vertices: NDArray[Any]
    faces: NDArray[np.int32]
    firsts: Firsts
    bins: int
    swept: int
    fewest: int
    unit: float
    pad: float
    rounding: float
    least_overlap: float
    """Of halves, as half an area."""


@inline
def kind_of(i, firsts):
    """TRIANGLES, SPHERES, ANALYTIC or INSTANCES: the kind of primitive number i."""
    return np.int64(i >= firsts.sphere) + np.int64(i >= firsts.analytic) + np.int64(i >= firsts.instance)


@inline
def _doubled_center(box):
    """Lower plus upper corner, and the same negated."""
    return box - swapped(box)


@inline
def _survey(records, first, last):
    """(box, box of the doubled centres) of some primitives."""
    box = centers = splat(np.float32(np.inf))
    for k in range(first, last):
        this = load8(records, 8 * k)
        box, centers = lesser(box, this), lesser(centers, _doubled_center(this))
    return box, centers


@inline
def _bins_per_unit(centers, axis, bins):
    """0 where an axis has no extent, so that everything lies in its first bin."""
    scale = np.float32(0.999999 * bins) / -lane(centers + swapped(centers), axis)
    return select((scale > np.float32(0)) & (scale < np.float32(1e37)), scale, np.float32(0))


@inline
def _fill_bins(records, first, last, centers, scale, boxes, counts, bins):
    for axis in range(3):
        for b in range(axis * BINS, axis * BINS + bins):
            store8(boxes, 8 * b, splat(np.float32(np.inf)))
            counts[b] = 0
    for k in range(first, last):
        box = load8(records, 8 * k)
        place = convert((_doubled_center(box) - centers) * scale, np.int32)
        for axis in range(3):
            b = axis * BINS + np.int64(lane(place, axis))
            store8(boxes, 8 * b, lesser(load8(boxes, 8 * b), box))
            counts[b] += 1


@inline
def _common_half_area(a, b):
    """Of what lies in both boxes."""
    common = select(a > b, a, b)
    extent = common + swapped(common)
    x, y, z = lane(extent, 0), lane(extent, 1), lane(extent, 2)
    return select((x < 0) & (y < 0) & (z < 0), x * y + y * z + z * x, np.float32(0))


@inline
def _best_plane(boxes, counts, behind, bins):
    """The best plane between two bins."""
    best = Plane(*NO_PLANE)
    for axis in range(3):
        best = better_plane(best, boxes, counts, counts, behind, axis, axis * BINS, bins)
    if best.axis < 0:  # all centres are equal
        return Plane(best.cost, best.axis, best.before, np.float32(np.inf))
    left = right = splat(np.float32(np.inf))
    for b in range(bins):
        box = load8(boxes, 8 * (best.axis * BINS + b))
        left, right = (lesser(left, box), right) if b < best.before else (left, lesser(right, box))
    return Plane(best.cost, best.axis, best.before, _common_half_area(left, right))


@inline
def _find_plane(source, start, n, centers, bins, scratch):
    """The best plane between bins of boxes."""
    boxes, behind = array_at(scratch, np.float32), array_at(scratch + 32 * 3 * BINS, np.float32)
    counts, few = array_at(scratch + 36 * 3 * BINS, np.int32), array_at(scratch + 40 * 3 * BINS, np.float32)
    bins = min(bins, 4 + n // 2)
    store8(few, 8, centers)
    store8(few, 0, splat(np.float32(0)))
    for axis in range(3):
        few[axis] = _bins_per_unit(centers, axis, bins)
    _fill_bins(source.boxes, start, start + n, centers, load8(few, 0), boxes, counts, bins)
    return _best_plane(boxes, counts, behind, bins)


@inline
def _sort_along(boxes, start, n, axis, keys, places):
    """Sorts the places of n parts by their centres along an axis, of equal ones by where they are."""
    for k in range(n):
        key = boxes[8 * (start + k) + axis] - boxes[8 * (start + k) + 4 + axis]
        j = k
        while j > 0 and keys[j - 1] > key:
            keys[j], places[j] = keys[j - 1], places[j - 1]
            j -= 1
        keys[j], places[j] = key, np.int32(start + k)


@inline
def _sweep(source, start, n, scratch):
    """The best of all planes between two of few parts, whose places are left in order along each axis."""
    keys, behind = array_at(scratch, np.float32), array_at(scratch + 4 * SWEPT, np.float32)
    least, best_axis, best = np.float32(np.inf), 0, n // 2
    for axis in range(3):
        places = array_at(scratch + 4 * SWEPT * (2 + axis), np.int32)
        _sort_along(source.boxes, start, n, axis, keys, places)
        box = splat(np.float32(np.inf))
        for k in range(n - 1, 0, -1):
            box = lesser(box, load8(source.boxes, 8 * np.int64(places[k])))
            behind[k] = np.float32(n - k) * half_area(box)
        box = splat(np.float32(np.inf))
        for k in range(1, n):
            box = lesser(box, load8(source.boxes, 8 * np.int64(places[k - 1])))
            cost = np.float32(k) * half_area(box) + behind[k]
            if cost < least:
                least, best_axis, best = cost, axis, k
    left = right = splat(np.float32(np.inf))
    places = array_at(scratch + 4 * SWEPT * (2 + best_axis), np.int32)
    for k in range(n):
        box = load8(source.boxes, 8 * np.int64(places[k]))
        left, right = (lesser(left, box), right) if k < best else (left, lesser(right, box))
    return Plane(least, best_axis, best, _common_half_area(left, right))


@inline
def _copy(growth, k):
    return Copy(
        array_at(growth.records.ctypes.data + k * growth.records.strides[0], np.float32),
        array_at(growth.order.ctypes.data + k * growth.order.strides[0], np.int32),
    )


@inline
def _move(source, target, window, before):
    """Moves parts to the other copy, so many first ones to the front of the window, the others to its back; returns how many
    are on either side."""
    shift = window.end - window.count
    for k in range(window.count):
        place, here = window.first + k if k < before else shift + k, window.start + k
        put(target, place, load8(source.boxes, 8 * here), source.order[here])
    return before, window.count - before


@inline
def _move_sorted(source, target, window, before, places):
    """The same in the order of `places`."""
    shift = window.end - window.count
    for k in range(window.count):
        place, here = window.first + k if k < before else shift + k, np.int64(places[k])
        put(target, place, load8(source.boxes, 8 * here), source.order[here])
    return before, window.count - before


@inline
def _move_by_plane(source, target, window, plane, scratch):
    """The same, those to the front of which the centre lies in a bin before the plane."""
    few, axis = array_at(scratch + 40 * 3 * BINS, np.float32), plane.axis
    low, scale = few[8 + axis], few[axis]
    front, back = window.first, window.end - 1
    for k in range(window.start, window.start + window.count):
        center = source.boxes[8 * k + axis] - source.boxes[8 * k + 4 + axis]
        before = np.int64(np.int32((center - low) * scale) < plane.before)
        place = back + before * (front - back)  # no branch: it would be missed half of the time
        put(target, place, load8(source.boxes, 8 * k), source.order[k])
        front += before
        back -= 1 - before
    return front - window.first, window.end - 1 - back


@inline
def _count_below(order, window, bound):
    """How many of the parts are of primitives numbered below a bound."""
    below = 0
    for k in range(window.start, window.start + window.count):
        below += np.int64(np.int64(order[k]) < bound)
    return below


@inline
def _move_by_number(source, target, window, bound):
    """The same, those to the front whose primitives are numbered below a bound."""
    front, back = window.first, window.end - 1
    for k in range(window.start, window.start + window.count):
        before = np.int64(np.int64(source.order[k]) < bound)
        put(target, back + before * (front - back), load8(source.boxes, 8 * k), source.order[k])
        front += before
        back -= 1 - before
    return front - window.first, window.end - 1 - back


@inline
def _divide(growth, node, copy, window, depth, scratch):
    """Writes a node and moves its parts to the other copy, to the front of the window and to its back; returns how many are on
    either side, 0 of a leaf."""
    n, start, source, target = window.count, window.start, _copy(growth, copy), _copy(growth, 1 - copy)
    box, centers = _survey(source.boxes, start, start + n)
    store8(array_at(growth.boxes.ctypes.data, np.float32), 8 * node, box)
    growth.links[node, 0], growth.links[node, 1], growth.links[node, 2] = start, n, 0
    if n <= LEAF:
        bound = np.int64(growth.firsts.sphere)
        below = _count_below(source.order, window, bound)
        if not 0 < below < n:
            bound = np.int64(growth.firsts.analytic)
            below = _count_below(source.order, window, bound)
        if not 0 < below < n:
            bound = np.int64(growth.firsts.instance)
            below = _count_below(source.order, window, bound)
        if 0 < below < n:
            return _move_by_number(source, target, window, bound)
        if n == 1 or (n <= growth.fewest and below == n):  # in the end `below` counts what is no instance
            return 0, 0
    if depth < DEEPEST:
        swept = n <= growth.swept
        plane = _sweep(source, start, n, scratch) if swept else _find_plane(source, start, n, centers, growth.bins, scratch)
        if plane.overlap > growth.least_overlap and window.end - window.first > n:
            cut = find_cut(growth, source, window, box, scratch + 4 * SEARCH)
            if cut.cost < plane.cost:
                before, behind = move_cut(growth, source, target, window, box, cut, scratch + 4 * SEARCH)
                if before > 0 and behind > 0:
                    return before, behind
        if swept:
            places = array_at(scratch + 4 * SWEPT * (2 + plane.axis), np.int32)
            return _move_sorted(source, target, window, plane.before, places)
        if plane.axis >= 0:
            return _move_by_plane(source, target, window, plane, scratch)
    return _move(source, target, window, n // 2)


@inline
def _window(first, end, start, count):
    """The window of a node. What may become a leaf has no room: its parts stay side by side."""
    return Window(first, end, start, count) if count > LEAF else Window(start, start + count, start, count)


@inline
def _windows(window, before, behind):
    """The windows of both halves, each with room in proportion to its parts."""
    room = window.end - window.first - before - behind
    middle = window.first + before + room * before // (before + behind)
    return _window(window.first, middle, window.first, before), _window(middle, window.end, window.end - behind, behind)


@inline
def _note(todo, k, node, copy, depth, window):
    todo[k, 0], todo[k, 1], todo[k, 2] = node, copy, depth
    todo[k, 3], todo[k, 4], todo[k, 5], todo[k, 6] = window


@kernel
def grow(growth, node, copy, window, depth, once, todo, scratch):
    """Grows all below a node and leaves the order of its parts in copy 0; returns the end of the places used. With `once` it is
    divided once: its halves have their places, but are not written yet, and are left in `todo` (n, 7), the second one first:
    node, copy, depth, window."""
    _note(todo, 0, node, copy, depth, window)
    top, used = 1, 2 * window[0] + 2
    while top > 0:
        top -= 1
        node, copy, depth = todo[top, 0], todo[top, 1], todo[top, 2]
        window = Window(todo[top, 3], todo[top, 4], todo[top, 5], todo[top, 6])
        before, behind = _divide(growth, node, copy, window, depth, scratch.ctypes.data)
        if before == 0:
            if copy == 1:
                for k in range(window.start, window.start + window.count):
                    growth.order[0, k] = growth.order[1, k]
            continue
        halves = _windows(window, before, behind)
        if once:
            used = 2 * halves[1].first
        growth.links[node, 2] = used
        _note(todo, top, used + 1, 1 - copy, depth + 1, halves[1])
        _note(todo, top + 1, used, 1 - copy, depth + 1, halves[0])
        top += 2
        if once:
            break
        used += 2
    return used


def grow_tree(growth: Growth, n: int, pool: Executor) -> tuple[list[tuple[int, int]], list[int]]:
    """Grows the tree over n primitives, which lie at the first places. Returns the ranges of places of nodes that were filled,
    in each of which nodes follow those they lie below, and the nodes above, each after all that lie below it."""
    large = max(TASK, n // 64)
    filled: list[tuple[int, int]] = []
    above: list[tuple[int, int]] = []

    def task(node: int, copy: int, depth: int, *window: int) -> list[Any]:
        """Grows a tree, or divides a large node; returns what is left to do."""
        todo, scratch = np.empty((2 * (DEEPEST + 40), 7), np.int64), np.empty(SCRATCH, np.float32)
        first, end, _, count = window
        once = count > large
        used = grow(growth, node, copy, window, depth, once, todo, scratch)
        if once:
            above.append((end - first, node))
            return todo[:2].tolist()
        above.append((0, node))
        filled.append((2 * first + 2, used))
        return []

    pending = deque([pool.submit(task, 0, 0, 0, *_window(0, growth.order.shape[1], 0, n))])
    while pending:
        pending.extend(pool.submit(task, *half) for half in pending.popleft().result())
    return filled, [node for _, node in sorted(above)]
