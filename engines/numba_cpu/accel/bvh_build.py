"""Growing a two-wide tree over boxes: binned surface area heuristic (Wald 2007), without recursion, by all threads.

A box is eight float32 numbers, its lower and its negated upper corner with a spare beside each, so that one vector
minimum joins two. A node is a box and a link (first, count, split): it holds the primitives order[first : first + count], and
unless split is 0 its halves are the nodes `split` and `split` + 1. The tree over primitives [first, last) owns the places
2 first + 2 .. 2 last - 1, so the nodes lie in the same places whichever thread puts them there, and in whatever order.
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

BINS = 16
LEAF = 8
"""Primitives a leaf may hold, all of one kind."""
DEEPEST = 48
"""Below this depth nodes are halved by count, which bounds the depth by DEEPEST + log2(n) + 1."""
TASK = 4096
"""Up to so many primitives are one task; what holds more is divided by a task of its own, up to 64 of them."""
SCRATCH = 10 * 3 * BINS + 16
TRIANGLES, SPHERES, ANALYTIC = range(3)
"""Kinds of primitives, in the order in which they are numbered."""


class Growth(NamedTuple):
    """`records` (2, n, 8) float32 boxes and `order` (2, n) int32: each division moves primitives from one copy to the other.
    `boxes` (2n, 8) float32 and `links` (2n, 3) int32: the tree. Up to `fewest` of a kind are not divided."""

    records: NDArray[np.float32]
    order: NDArray[np.int32]
    boxes: NDArray[np.float32]
    links: NDArray[np.int32]
    first_sphere: int
    first_analytic: int
    fewest: int


@inline
def kind_of(i, first_sphere, first_analytic):
    """TRIANGLES, SPHERES or ANALYTIC: the kind of primitive number i."""
    return np.int64(i >= first_sphere) + np.int64(i >= first_analytic)


@inline
def half_area(box):
    extent = box + swapped(box)  # lower minus upper corner
    x, y, z = lane(extent, 0), lane(extent, 1), lane(extent, 2)
    return x * y + y * z + z * x


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
def _best_plane(boxes, counts, behind, n, bins):
    """(axis, last bin before the plane) where count times area, summed over both sides, is least; axis -1 for none."""
    least, best_axis, best_bin = np.float32(np.inf), -1, 0
    for axis in range(3):
        box, held = splat(np.float32(np.inf)), 0
        for b in range(axis * BINS + bins - 1, axis * BINS, -1):
            box = lesser(box, load8(boxes, 8 * b))
            held += np.int64(counts[b])
            behind[b] = np.float32(held) * half_area(box)
        box, held = splat(np.float32(np.inf)), 0
        for b in range(axis * BINS, axis * BINS + bins - 1):
            box = lesser(box, load8(boxes, 8 * b))
            held += np.int64(counts[b])
            cost = np.float32(held) * half_area(box) + behind[b + 1]
            if cost < least and held > 0 and held < n:  # an empty side costs NaN or inf
                least, best_axis, best_bin = cost, axis, b - axis * BINS
    return best_axis, best_bin


@inline
def _divide_by_plane(source, target, first, last, centers, scratch):
    """Moves primitives to the other copy, those before the best plane to the front; returns how many those are, or 0 and moves
    nothing where there is no plane."""
    n = last - first
    boxes, behind = array_at(scratch, np.float32), array_at(scratch + 32 * 3 * BINS, np.float32)
    counts, few = array_at(scratch + 36 * 3 * BINS, np.int32), array_at(scratch + 40 * 3 * BINS, np.float32)
    bins = min(BINS, 4 + n // 2)
    store8(few, 8, centers)
    store8(few, 0, splat(np.float32(0)))
    for axis in range(3):
        few[axis] = _bins_per_unit(centers, axis, bins)
    _fill_bins(source.boxes, first, last, centers, load8(few, 0), boxes, counts, bins)
    axis, plane = _best_plane(boxes, counts, behind, n, bins)
    if axis < 0:
        return 0
    low, scale = few[8 + axis], few[axis]
    front, back = first, last - 1
    for k in range(first, last):
        center = source.boxes[8 * k + axis] - source.boxes[8 * k + 4 + axis]
        before = np.int64(np.int32((center - low) * scale) <= plane)
        place = back + before * (front - back)  # no branch: it would be missed half of the time
        store8(target.boxes, 8 * place, load8(source.boxes, 8 * k))
        target.order[place] = source.order[k]
        front += before
        back -= 1 - before
    return front - first


class Copy(NamedTuple):
    """Arrays of one of the two copies of the primitives."""

    boxes: Any
    order: Any


@inline
def _copy(growth, k):
    return Copy(
        array_at(growth.records.ctypes.data + k * growth.records.strides[0], np.float32),
        array_at(growth.order.ctypes.data + k * growth.order.strides[0], np.int32),
    )


@inline
def _move(source, target, first, last):
    for k in range(first, last):
        store8(target.boxes, 8 * k, load8(source.boxes, 8 * k))
        target.order[k] = source.order[k]


@inline
def _count_below(order, first, last, bound):
    """How many of order[first:last] are below a bound."""
    below = 0
    for k in range(first, last):
        below += np.int64(np.int64(order[k]) < bound)
    return below


@inline
def _divide_by_number(source, target, first, last, bound):
    """Moves primitives to the other copy, those numbered below a bound to the front; returns how many those are."""
    front, back = first, last - 1
    for k in range(first, last):
        before = np.int64(np.int64(source.order[k]) < bound)
        place = back + before * (front - back)
        store8(target.boxes, 8 * place, load8(source.boxes, 8 * k))
        target.order[place] = source.order[k]
        front += before
        back -= 1 - before
    return front - first


@inline
def _divide(growth, node, copy, first, last, depth, scratch):
    """Writes a node and moves its primitives to the other copy, in two parts; returns where the second begins, -1 for a
    leaf."""
    n, source, target = last - first, _copy(growth, copy), _copy(growth, 1 - copy)
    box, centers = _survey(source.boxes, first, last)
    store8(array_at(growth.boxes.ctypes.data, np.float32), 8 * node, box)
    growth.links[node, 0], growth.links[node, 1], growth.links[node, 2] = first, n, 0
    if n <= LEAF:
        bound = growth.first_sphere
        below = _count_below(source.order, first, last, bound)
        if growth.first_analytic < growth.order.shape[1] and not 0 < below < n:
            bound = growth.first_analytic
            below = _count_below(source.order, first, last, bound)
        if 0 < below < n:
            return first + _divide_by_number(source, target, first, last, bound)
        if n <= growth.fewest:
            return -1
    size = 0
    if depth < DEEPEST:
        size = _divide_by_plane(source, target, first, last, centers, scratch)
    if size == 0:
        size = n // 2
        _move(source, target, first, last)
    return first + size


@kernel
def divide(growth, node, copy, first, last, depth, scratch):
    """Divides a large node once; its halves have their places, but are not written yet."""
    middle = _divide(growth, node, copy, first, last, depth, scratch.ctypes.data)
    growth.links[node, 2] = 2 * middle
    return middle


@kernel
def grow(growth, node, copy, first, last, depth, scratch):
    """Grows all below a node and leaves its primitives' order in copy 0; returns the end of the places used."""
    todo = np.empty((2 * (DEEPEST + 40), 5), np.int64)
    todo[0, 0], todo[0, 1], todo[0, 2], todo[0, 3], todo[0, 4] = node, copy, first, last, depth
    top, used = 1, 2 * first + 2
    while top > 0:
        top -= 1
        node, copy, first, last, depth = todo[top, 0], todo[top, 1], todo[top, 2], todo[top, 3], todo[top, 4]
        middle = _divide(growth, node, copy, first, last, depth, scratch.ctypes.data)
        if middle < 0:
            if copy == 1:
                for k in range(first, last):
                    growth.order[0, k] = growth.order[1, k]
            continue
        growth.links[node, 2] = used
        for side in range(2):
            todo[top, 0], todo[top, 1], todo[top, 4] = used + 1 - side, 1 - copy, depth + 1
            todo[top, 2], todo[top, 3] = (first, middle) if side else (middle, last)
            top += 1
        used += 2
    return used


def grow_tree(growth: Growth, pool: Executor) -> tuple[list[tuple[int, int]], list[int]]:
    """Grows the tree over all primitives. Returns the ranges of places that were filled, in each of which nodes follow those
    they lie below, and the nodes above, each after all that lie below it."""
    n = growth.order.shape[1]
    large = max(TASK, n // 64)
    filled: list[tuple[int, int]] = []
    above: list[tuple[int, int]] = []
    pending: deque[Any] = deque()

    def task(node: int, copy: int, first: int, last: int, depth: int) -> None:
        scratch = np.empty(SCRATCH, np.float32)
        if last - first <= large:
            filled.append((2 * first + 2, grow(growth, node, copy, first, last, depth, scratch)))
            above.append((0, node))
            return
        middle = divide(growth, node, copy, first, last, depth, scratch)
        above.append((last - first, node))
        pending.append(pool.submit(task, 2 * middle, 1 - copy, first, middle, depth + 1))
        pending.append(pool.submit(task, 2 * middle + 1, 1 - copy, middle, last, depth + 1))

    pending.append(pool.submit(task, 0, 0, 0, n, 0))
    while pending:
        pending.popleft().result()
    return filled, [node for _, node in sorted(above)]
