"""Builds the tree of boxes: binned surface-area heuristic (Wald 2007), all nodes of a level at once.

First a binary tree; then each node takes in its largest inner children until it has eight, which suits a traversal
that tests many boxes with one call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.vectors import Array, Indices

WIDTH = 8
BINS = 16
DEEPEST_SAH_LEVEL = 48
"""Below this level nodes are halved by count, so that no input makes the tree deep."""


class Binary(NamedTuple):
    """Nodes of the binary tree: boxes (3, k), `left` child (k,), the right one being next, -1 for a leaf, and the range
    [start, end) of the primitives in `order`."""

    low: Array
    high: Array
    left: Indices
    start: Indices
    end: Indices
    order: Indices


class Wide(NamedTuple):
    """Nodes of the wide tree. `bounds` (6, 8, k): lower then upper corners of the children, NaN where there is none.
    `child` (8, k): a node, or `k` + a leaf. `leaves` (leaf_size, l): primitives, ascending, m where there is none."""

    bounds: Array
    child: Indices
    leaves: Indices
    depth: int


def build(low: Array, high: Array, leaf_size: int) -> Wide:
    """The wide tree over m > 0 boxes with corners (3, m); leaves hold at most `leaf_size` primitives."""
    return _widened(_binary(low, high, leaf_size), leaf_size)


def _binary(low: Array, high: Array, leaf_size: int) -> Binary:
    center = 0.5 * low + 0.5 * high
    order = np.arange(low.shape[1])
    starts, ends, lefts = [np.zeros(1, np.int64)], [np.array([order.size])], []
    made, level = 1, 0
    while starts[-1].size:
        start, end = starts[-1], ends[-1]
        inner = np.flatnonzero(end - start > leaf_size)
        left = np.full(start.size, -1)
        left[inner] = made + 2 * np.arange(inner.size)
        lefts.append(left)
        start, end = start[inner], end[inner]
        middle = _split(low, high, center, order, start, end, level)
        starts.append(np.stack([start, middle], axis=1).reshape(-1))
        ends.append(np.stack([middle, end], axis=1).reshape(-1))
        made, level = made + 2 * inner.size, level + 1
    start, end = np.concatenate(starts), np.concatenate(ends)
    boxes = _node_boxes(low[:, order], high[:, order], starts, ends, lefts)
    return Binary(*boxes, np.concatenate(lefts), start, end, order)


def _split(low: Array, high: Array, center: Array, order: Indices, start: Indices, end: Indices, level: int) -> Indices:
    """Sorts the part of `order` in each node [start, end) into two and returns where the second one begins."""
    if not start.size:
        return start
    count = end - start
    node = np.repeat(np.arange(start.size), count)
    place = np.arange(node.size) - np.repeat(np.cumsum(count) - count, count)
    where = np.repeat(start, count) + place
    items = order[where]
    right = place >= (count // 2)[node]
    if level < DEEPEST_SAH_LEVEL:
        bins = _bins(center[:, items], node, start.size)
        axis, last, splits = _best_planes(low[:, items], high[:, items], bins, node, start.size)
        chosen = np.take_along_axis(bins, axis[node][None], axis=0)[0]
        right = np.where(splits[node], chosen > last[node], right)
    sorting = np.argsort(2 * node + right, kind="stable")
    order[where] = items[sorting]
    return end - np.bincount(node, right, start.size).astype(np.int64)


def _bins(center: Array, node: Indices, nodes: int) -> Indices:
    """(3, m): which of the equal slices of its node's range of centres each primitive falls into, on each axis."""
    first, last = np.full((3, nodes), np.inf), np.full((3, nodes), -np.inf)
    for axis in range(3):
        np.minimum.at(first[axis], node, center[axis])
        np.maximum.at(last[axis], node, center[axis])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        share = (center - first[:, node]) / (last - first)[:, node]
    return np.minimum(np.nan_to_num(share) * BINS, BINS - 1).astype(np.int64)


def _best_planes(low: Array, high: Array, bins: Indices, node: Indices, nodes: int) -> tuple[Indices, Indices, np.ndarray]:
    """The axis, the last bin on the left, and whether there is a split at all, (nodes,) each."""
    cost = np.empty((3, nodes, BINS - 1))
    for axis in range(3):
        key = node * BINS + bins[axis]
        count = np.bincount(key, minlength=nodes * BINS).reshape(nodes, BINS)
        box = np.full((2, 3, nodes * BINS), np.inf)
        for k in range(3):
            np.minimum.at(box[0, k], key, low[k])
            np.minimum.at(box[1, k], key, -high[k])
        box = box.reshape(2, 3, nodes, BINS)
        left = np.minimum.accumulate(box, axis=-1)[..., :-1]
        right = np.minimum.accumulate(box[..., ::-1], axis=-1)[..., ::-1][..., 1:]
        before = np.cumsum(count, axis=1)[:, :-1]
        after = count.sum(axis=1)[:, None] - before
        with np.errstate(invalid="ignore", over="ignore"):
            sides = _half_area(left[0], -left[1]) * before + _half_area(right[0], -right[1]) * after
        cost[axis] = np.where((before > 0) & (after > 0) & np.isfinite(sides), sides, np.inf)
    cheapest = cost.transpose(1, 0, 2).reshape(nodes, -1)
    best = cheapest.argmin(axis=1)
    return best // (BINS - 1), best % (BINS - 1), np.isfinite(cheapest.min(axis=1))


def _half_area(low: Array, high: Array) -> Array:
    x, y, z = high - low
    return x * y + y * z + z * x


def _node_boxes(low: Array, high: Array, starts: list, ends: list, lefts: list) -> tuple[Array, Array]:
    """Boxes of all nodes, from the leaves upwards; `low` and `high` in the order of the leaves."""
    below_low, below_high, levels = np.zeros((3, 0)), np.zeros((3, 0)), []
    for start, end, left in zip(starts[-2::-1], ends[-2::-1], lefts[::-1], strict=True):
        box_low, box_high = np.full((3, start.size), np.inf), np.full((3, start.size), -np.inf)
        inner, leaf = np.flatnonzero(left >= 0), np.flatnonzero(left < 0)
        box_low[:, inner] = np.minimum(below_low[:, 0::2], below_low[:, 1::2])
        box_high[:, inner] = np.maximum(below_high[:, 0::2], below_high[:, 1::2])
        for k in range(int((end - start)[leaf].max(initial=0))):
            held = leaf[start[leaf] + k < end[leaf]]
            box_low[:, held] = np.minimum(box_low[:, held], low[:, start[held] + k])
            box_high[:, held] = np.maximum(box_high[:, held], high[:, start[held] + k])
        levels.append((box_low, box_high))
        below_low, below_high = box_low, box_high
    return (
        np.concatenate([box for box, _ in reversed(levels)], axis=1),
        np.concatenate([box for _, box in reversed(levels)], axis=1),
    )


def _widened(tree: Binary, leaf_size: int) -> Wide:
    with np.errstate(over="ignore"):
        area = _half_area(tree.low, tree.high).tolist()
    left = tree.left.tolist()
    roots, families, depths = [0], [], [1]
    node_of: dict[int, int] = {0: 0}
    for root in roots:  # grows while it is read: breadth first
        family = _family(root, left, area)
        families.append(family)
        for member in family:
            if left[member] >= 0:
                node_of[member] = len(roots)
                depths.append(depths[node_of[root]] + 1)
                roots.append(member)
    return _packed(tree, families, node_of, depths[-1], leaf_size)


def _family(root: int, left: list[int], area: list[float]) -> list[int]:
    """Up to eight descendants of a binary node whose boxes together hold all it holds."""
    if left[root] < 0:
        return [root]
    family = [left[root], left[root] + 1]
    while len(family) < WIDTH:
        inner = [member for member in family if left[member] >= 0]
        if not inner:
            break
        largest = max(inner, key=area.__getitem__)
        family[family.index(largest)] = left[largest]
        family.append(left[largest] + 1)
    return family


def _packed(tree: Binary, families: list[list[int]], node_of: dict[int, int], depth: int, leaf_size: int) -> Wide:
    nodes, members = len(families), np.full((len(families), WIDTH), -1)
    for node, family in enumerate(families):
        members[node, : len(family)] = family
    members = members.T
    absent = members < 0
    bounds = np.concatenate([tree.low, tree.high])[:, members]
    bounds[:, absent] = np.nan
    number = np.full(tree.left.size, -1)
    number[list(node_of)] = list(node_of.values())
    is_leaf = np.flatnonzero(tree.left < 0)
    number[is_leaf] = nodes + np.arange(is_leaf.size)
    child = np.where(absent, 0, number[members])
    place = tree.start[is_leaf] + np.arange(leaf_size)[:, None]
    held = place < tree.end[is_leaf]
    leaves = np.where(held, tree.order[np.minimum(place, tree.order.size - 1)], tree.order.size)
    return Wide(bounds, child, np.sort(leaves, axis=0), depth)
