"""Planes that cut triangles in two while a tree is grown: spatial splits after Stich, Friedrich and Dietrich (2009).

Where the halves of a node overlap much, as around long triangles that lie aslant, a plane that cuts what it meets can be
better than one that leaves primitives whole. A cut part enters both halves, each with the box of what lies of it there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.simd import lane, lesser, load8, splat, store8, swapped
from engines.numba_cpu.accel.primitives import outward

EPS = float(np.finfo(np.float32).eps)
CUTS = 16
"""Bins between planes that cut."""
CUT_SCRATCH = 11 * 3 * CUTS + 16
"""Numbers that the search works on."""


@inline
def half_area(box):
    extent = box + swapped(box)  # lower minus upper corner
    x, y, z = lane(extent, 0), lane(extent, 1), lane(extent, 2)
    return x * y + y * z + z * x


class Plane(NamedTuple):
    """A division in two: what it costs, count times half an area, summed over both sides; the axis, -1 for none; how many bins
    or parts lie before it; what the sides have in common."""

    cost: float
    axis: int
    before: int
    overlap: float


NO_PLANE = np.float32(np.inf), np.int64(-1), np.int64(0), np.float32(0)


@inline
def better_plane(best, boxes, begun, ended, behind, axis, first, bins):
    """The best of a plane and of those between the bins of an axis, which lie from `first` on: how many parts begin and end in
    each, and the box of what lies there. An empty side costs NaN or inf. Its overlap is not computed."""
    box, held = splat(np.float32(np.inf)), 0
    for b in range(first + bins - 1, first, -1):
        box = lesser(box, load8(boxes, 8 * b))
        held += np.int64(ended[b])
        behind[b] = np.float32(held) * half_area(box)
    box, held = splat(np.float32(np.inf)), 0
    for b in range(first, first + bins - 1):
        box = lesser(box, load8(boxes, 8 * b))
        held += np.int64(begun[b])
        cost = np.float32(held) * half_area(box) + behind[b + 1]
        if cost < best.cost:
            best = Plane(cost, np.int64(axis), np.int64(b + 1 - first), np.float32(0))
    return best


class Copy(NamedTuple):
    """Arrays of one of the two copies of the parts."""

    boxes: Any
    order: Any


class Window(NamedTuple):
    """The places [first, end) that belong to a node, and where its parts start among them."""

    first: int
    end: int
    start: int
    count: int


@inline
def put(target, place, box, primitive):
    """Writes a part to a copy."""
    store8(target.boxes, 8 * place, box)
    target.order[place] = primitive


@inline
def _cut(growth, i, box, axis, at, left, right):
    """Boxes of what lies of part `box` of primitive i on both sides of a plane. A side without anything of it is empty."""
    store8(left, 0, box)
    store8(right, 0, box)
    margin = np.float32(growth.pad / growth.unit) + abs(at) * np.float32(4 * EPS)
    left[4 + axis], right[axis] = max(left[4 + axis], -(at + margin)), max(right[axis], at - margin)
    if i >= growth.firsts.sphere:
        return
    plane = np.float64(at) * growth.unit
    for side, sign in ((left, 1.0), (right, -1.0)):
        for k in range(3):
            low, high, corner = np.inf, -np.inf, 2
            for after in range(3):
                a, b = growth.faces[i, corner], growth.faces[i, after]
                p, q = np.float64(growth.vertices[a, axis]), np.float64(growth.vertices[b, axis])
                x, y = np.float64(growth.vertices[a, k]), np.float64(growth.vertices[b, k])
                if sign * p <= sign * plane:
                    low, high = min(low, x), max(high, x)
                if (p < plane) != (q < plane):
                    met = plane if k == axis else x + (plane - p) / (q - p) * (y - x)
                    low, high = min(low, met), max(high, met)
                corner = after
            if low > high:
                side[k] = np.inf
                continue
            lower, negated_upper = outward(low, high, growth.pad, growth.rounding, growth.unit)
            side[k], side[4 + k] = max(side[k], lower), max(side[4 + k], negated_upper)
        if side[0] > -side[4] or side[1] > -side[5] or side[2] > -side[6]:
            store8(side, 0, splat(np.float32(np.inf)))


class Cuts(NamedTuple):
    """Memory of the search for a plane that cuts: boxes of bins, and of both sides of a part; how many parts begin and end in
    a bin; costs."""

    boxes: Any
    left: Any
    right: Any
    begun: Any
    ended: Any
    behind: Any


@inline
def _cuts(scratch):
    bins, sides = 3 * CUTS, scratch + 96 * CUTS
    rest = sides + 64
    return Cuts(
        array_at(scratch, np.float32),
        array_at(sides, np.float32),
        array_at(sides + 32, np.float32),
        array_at(rest, np.int32),
        array_at(rest + 4 * bins, np.int32),
        array_at(rest + 8 * bins, np.float32),
    )


class Bins(NamedTuple):
    """The bins of a node's box along an axis: where they begin, how wide one is, and its inverse."""

    low: float
    width: float
    per_unit: float


@inline
def _bins_of(box, axis):
    low, width = lane(box, axis), (-lane(box, 4 + axis) - lane(box, axis)) / np.float32(CUTS)
    return Bins(low, width, np.float32(1) / width)


@inline
def _bin_of(bins, x):
    return min(max(np.int64((x - bins.low) * bins.per_unit), 0), CUTS - 1)


@inline
def _fill_cuts(growth, source, window, box, axis, cuts):
    for b in range(axis * CUTS, axis * CUTS + CUTS):
        store8(cuts.boxes, 8 * b, splat(np.float32(np.inf)))
        cuts.begun[b] = cuts.ended[b] = 0
    left, right, bins = cuts.left, cuts.right, _bins_of(box, axis)
    for k in range(window.start, window.start + window.count):
        first, last = _bin_of(bins, source.boxes[8 * k + axis]), _bin_of(bins, -source.boxes[8 * k + 4 + axis])
        cuts.begun[axis * CUTS + first] += 1
        cuts.ended[axis * CUTS + last] += 1
        part = load8(source.boxes, 8 * k)
        for b in range(axis * CUTS + first, axis * CUTS + last):
            at = bins.low + bins.width * np.float32(b + 1 - axis * CUTS)
            _cut(growth, np.int64(source.order[k]), part, axis, at, left, right)
            store8(cuts.boxes, 8 * b, lesser(load8(cuts.boxes, 8 * b), load8(left, 0)))
            part = load8(right, 0)
        b = axis * CUTS + last
        store8(cuts.boxes, 8 * b, lesser(load8(cuts.boxes, 8 * b), part))


@inline
def find_cut(growth, source, window, box, scratch):
    """The best plane that cuts parts in two."""
    cuts, best = _cuts(scratch), Plane(*NO_PLANE)
    for axis in range(3):
        if not (-lane(box, 4 + axis) - lane(box, axis) > np.float32(64 * EPS)):
            continue
        _fill_cuts(growth, source, window, box, axis, cuts)
        best = better_plane(best, cuts.boxes, cuts.begun, cuts.ended, cuts.behind, axis, axis * CUTS, CUTS)
    return best


@inline
def _cost(n, box, m, other):
    return np.float32(n) * half_area(box) + np.float32(m) * half_area(other)


@inline
def move_cut(growth, source, target, window, box, plane, scratch):
    """Moves parts to both sides of a plane, and cuts those in two that lie on both, as long as there is room and neither side
    is better without it; returns (how many lie before it, how many behind it)."""
    axis, cuts = plane.axis, _cuts(scratch)
    left, right, bins = cuts.left, cuts.right, _bins_of(box, axis)
    before_box = behind_box = splat(np.float32(np.inf))
    n_before, n_behind = 0, 0
    for b in range(CUTS):
        bin_box, k = load8(cuts.boxes, 8 * (axis * CUTS + b)), axis * CUTS + b
        if b < plane.before:
            before_box, n_before = lesser(before_box, bin_box), n_before + np.int64(cuts.begun[k])
        else:
            behind_box, n_behind = lesser(behind_box, bin_box), n_behind + np.int64(cuts.ended[k])
    at, front, back = bins.low + bins.width * np.float32(plane.before), window.first, window.end - 1
    room = window.end - window.first - window.count
    for k in range(window.start, window.start + window.count):
        part, i = load8(source.boxes, 8 * k), np.int64(source.order[k])
        before = _bin_of(bins, source.boxes[8 * k + axis]) < plane.before
        behind = _bin_of(bins, -source.boxes[8 * k + 4 + axis]) >= plane.before
        if before and behind:
            _cut(growth, i, part, axis, at, left, right)
            both = _cost(n_before, before_box, n_behind, behind_box)
            only_before = _cost(n_before, lesser(before_box, part), n_behind - 1, behind_box)
            only_behind = _cost(n_before - 1, before_box, n_behind, lesser(behind_box, part))
            if not left[0] < np.float32(np.inf):
                before, n_before = False, n_before - 1
            elif not right[0] < np.float32(np.inf):
                behind, n_behind = False, n_behind - 1
            elif room == 0 or only_before < both or only_behind < both:
                if only_before < only_behind:
                    behind, n_behind, before_box = False, n_behind - 1, lesser(before_box, part)
                else:
                    before, n_before, behind_box = False, n_before - 1, lesser(behind_box, part)
            else:
                room -= 1
                put(target, front, load8(left, 0), source.order[k])
                put(target, back, load8(right, 0), source.order[k])
                front += 1
                back -= 1
                continue
        put(target, front if before else back, part, source.order[k])
        front += np.int64(before)
        back -= np.int64(not before)
    return front - window.first, window.end - 1 - back
