"""Building a two-wide bounding volume hierarchy: binned surface area heuristic (Wald 2007), no recursion.

An inner node holds the boxes of both children: twelve numbers, lower then upper corner of the first, then of the second. A
child is the index of an inner node, or for a leaf -1 - (16 first + count), its primitives being order[first : first + count].
"""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.jit import inline, kernel

BINS = 16
LEAF = 4
"""Primitives a leaf may hold where splitting does not pay; never more."""
TRAVERSAL_COST = 1.0
DEEPEST = 48
"""Below this depth nodes are halved by count, which bounds the depth by DEEPEST + log2(n)."""
STACK = 96


@inline
def _area(box):
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


@inline
def _grow(box, boxes, i):
    for axis in range(3):
        box[axis] = min(box[axis], boxes[i, axis])
        box[3 + axis] = max(box[3 + axis], boxes[i, 3 + axis])


@inline
def _reset(box):
    for axis in range(3):
        box[axis], box[3 + axis] = math.inf, -math.inf


@inline
def _centroid(boxes, i, axis):
    return 0.5 * (np.float64(boxes[i, axis]) + np.float64(boxes[i, 3 + axis]))


@inline
def _join(box, other):
    for axis in range(3):
        box[axis], box[3 + axis] = min(box[axis], other[axis]), max(box[3 + axis], other[3 + axis])


@inline
def _split(boxes, order, first, last, box, bins, sizes, right, ends):
    """The best of the binned planes: (axis, bin, low, scale), axis -1 where all centroids coincide or a leaf is cheaper."""
    _reset(ends)
    for k in range(first, last):
        for axis in range(3):
            c = _centroid(boxes, order[k], axis)
            ends[axis], ends[3 + axis] = min(ends[axis], c), max(ends[3 + axis], c)
    total = last - first
    best, best_axis, best_bin, best_low, best_scale = math.inf, -1, 0, 0.0, 0.0
    for axis in range(3):
        low, width = ends[axis], ends[3 + axis] - ends[axis]
        scale = BINS * (1.0 - 1e-9) / width
        if not (width > 0.0 and math.isfinite(scale)):
            continue
        for b in range(BINS):
            _reset(bins[b])
            sizes[b] = 0
        for k in range(first, last):
            b = int((_centroid(boxes, order[k], axis) - low) * scale)
            sizes[b] += 1
            _grow(bins[b], boxes, order[k])
        n, side = 0, bins[BINS]
        _reset(side)
        for b in range(BINS - 1, 0, -1):
            n += sizes[b]
            _join(side, bins[b])
            right[b] = n * _area(side) if n else 0.0
        n = 0
        _reset(side)
        for b in range(BINS - 1):
            n += sizes[b]
            _join(side, bins[b])
            if 0 < n < total:
                cost = n * _area(side) + right[b + 1]
                if cost < best:
                    best, best_axis, best_bin, best_low, best_scale = cost, axis, b, low, scale
    area = _area(box)
    if total <= LEAF and best + TRAVERSAL_COST * area >= total * area:
        best_axis = -1
    return best_axis, best_bin, best_low, best_scale


@kernel
def build(boxes, order, nodes, children):
    """Fills `order` (n,), `nodes` (n, 12) and `children` (n, 2); returns how many inner nodes there are (0 or more).

    With at most LEAF primitives there is one inner node with one leaf and an empty one.
    """
    n = len(order)
    bins, sizes, right = np.empty((BINS + 1, 6)), np.zeros(BINS, np.int64), np.zeros(BINS)
    box, ends = np.empty(6), np.empty(6)
    for i in range(n):
        order[i] = i
    # tasks: first, last, depth, and where the result goes: node * 2 + side
    tasks = np.empty((2 * (DEEPEST + 40), 4), np.int64)
    used = 1
    nodes[0, 0:3], nodes[0, 3:6] = math.inf, -math.inf
    nodes[0, 6:9], nodes[0, 9:12] = math.inf, -math.inf
    children[0, 0], children[0, 1] = -1, -1
    if n == 0:
        return 1
    top = 1
    tasks[0, 0], tasks[0, 1], tasks[0, 2], tasks[0, 3] = 0, n, 0, 0
    while top > 0:
        top -= 1
        first, last, depth, place = tasks[top, 0], tasks[top, 1], tasks[top, 2], tasks[top, 3]
        node, side = place // 2, place % 2
        _reset(box)
        for k in range(first, last):
            _grow(box, boxes, order[k])
        for a in range(6):
            nodes[node, 6 * side + a] = box[a]
        axis, plane, low, scale = -1, 0, 0.0, 0.0
        if last - first > 1 and depth < DEEPEST:
            axis, plane, low, scale = _split(boxes, order, first, last, box, bins, sizes, right, ends)
        if axis < 0 and last - first <= LEAF:
            children[node, side] = -1 - (16 * first + (last - first))
            continue
        middle = (first + last) // 2
        if axis >= 0:
            i, j = first, last - 1
            while i <= j:
                if int((_centroid(boxes, order[i], axis) - low) * scale) <= plane:
                    i += 1
                else:
                    order[i], order[j] = order[j], order[i]
                    j -= 1
            middle = i
        if place == 0 and used == 1 and depth == 0:
            inner = 0  # the root's own place
        else:
            inner = used
            used += 1
            children[node, side] = inner
        tasks[top, 0], tasks[top, 1], tasks[top, 2], tasks[top, 3] = middle, last, depth + 1, 2 * inner + 1
        tasks[top + 1, 0], tasks[top + 1, 1], tasks[top + 1, 2], tasks[top + 1, 3] = first, middle, depth + 1, 2 * inner
        top += 2
    return used
