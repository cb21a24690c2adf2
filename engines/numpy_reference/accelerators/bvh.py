"""The accelerator `bvh`: many rays walk an eight-wide tree together, each with its own place in it.

A fixed number of lanes is kept busy: in each round every lane takes one step, either the eight boxes of a node or the
primitives of a leaf, and a lane that is done takes the next ray. Boxes are padded by more than the rounding errors
of any hit in them, so that the hits are those of `none`, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from engines.numpy_reference.accelerators.bvh_build import WIDTH, build
from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.vectors import EPSILON, Array, Indices

LANES = 8192
CHILD_BITS = 24
CHILD = (1 << CHILD_BITS) - 1
FAR = np.iinfo(np.int64).max
# The odd-even merge sort (Batcher 1968) for eight values.
SORTING_NETWORK = (
    (0, 1),
    (2, 3),
    (4, 5),
    (6, 7),
    (0, 2),
    (1, 3),
    (4, 6),
    (5, 7),
    (1, 2),
    (5, 6),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
    (2, 4),
    (3, 5),
    (1, 2),
    (3, 4),
    (5, 6),
)


class Bvh:
    """The tree over one kind of primitive, which must be bounded."""

    def __init__(self, primitives: Primitives, leaf_size: int) -> None:
        self._primitives = primitives
        low, high = primitives.bounds()
        tree = build(low, high, leaf_size)
        self._nodes, self._leaf_count = tree.child.shape[1], tree.leaves.shape[1]
        # A row for each node and leaf, so that it comes from memory in one piece.
        self._bounds = np.ascontiguousarray(tree.bounds.reshape(-1, self._nodes).T)
        self._child, self._leaves = np.ascontiguousarray(tree.child.T), np.ascontiguousarray(tree.leaves.T)
        self._stack_size = (WIDTH - 1) * tree.depth + 1
        self._extent = max(np.abs(low).max(), np.abs(high).max())
        # A primitive that is never hit fills incomplete leaves.
        copies, fields, count = primitives.data.shape
        data = np.concatenate([primitives.data, np.full((copies, fields, 1), np.nan)], axis=2)
        self._data = data.take(tree.leaves.T, axis=2).transpose(0, 2, 1, 3).reshape(copies * self._leaf_count, -1)
        self._primitive_id = np.append(primitives.primitive_id, np.iinfo(np.int64).max)
        if self._nodes + self._leaf_count > CHILD:
            raise MemoryError(f"bvh: {count} primitives need more than {CHILD} nodes")

    @property
    def nbytes(self) -> int:
        """Memory of the tree and of its copy of the primitives."""
        return self._bounds.nbytes + self._child.nbytes + self._leaves.nbytes + self._data.nbytes

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower id."""
        _Walk(self, origin, direction, nearest, any_hit=False).run(check)

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> np.ndarray:
        """(n,) whether anything lies in (0, before.t); overwrites `before`."""
        _Walk(self, origin, direction, before, any_hit=True).run(check)
        return before.primitive_id >= 0


class _Walk:
    """One batch of rays on its way through the tree.

    Lane i serves ray `ray[i]` and stands at `place[i]`: a node, `nodes` + a leaf, or -1 when it wants a place from its
    stack. A stack entry is one integer: the bits of t where the ray enters, and in their lowest bits the place.
    Positive floats sort like their bits, so sorting entries sorts places by t.
    """

    def __init__(self, tree: Bvh, origin: Array, direction: Array, nearest: Nearest, any_hit: bool) -> None:
        self.tree, self.nearest, self.any_hit = tree, nearest, any_hit
        self.left = nearest.origins_among(tree._primitives)
        self.slabs = slabs_of(origin, direction, tree._extent)
        self.copies, self.rays = tree._primitives.rays(origin, direction)
        self.rays = np.ascontiguousarray(self.rays)  # `take` copies the whole of an array that is not
        self.copies = self.copies * tree._leaf_count
        self.waiting = 0
        self.lanes = min(LANES, origin.shape[1])
        self.ray = np.zeros(self.lanes, np.int64)
        self.place = np.zeros(self.lanes, np.int64)
        self.height = np.zeros(self.lanes, np.int64)
        self.stack = np.empty(self.lanes * tree._stack_size, np.int64)
        self.base = np.arange(self.lanes) * tree._stack_size

    def run(self, check: Callable[[], None]) -> None:
        """Walks until every ray is done."""
        lanes = self._begin(np.arange(self.lanes))
        while lanes.size:
            check()
            at_node = self.place[lanes] < self.tree._nodes
            if at_node.any():
                self._enter_nodes(lanes[at_node])
            if not at_node.all():
                self._test_leaves(lanes[~at_node])
            done = self._pop(lanes)
            lanes = np.concatenate([lanes[self.place[lanes] >= 0], self._begin(done)])

    def _begin(self, idle: Indices) -> Indices:
        """Gives idle lanes the rays that wait; returns the lanes that got one."""
        idle = idle[: self.slabs.shape[1] - self.waiting]
        self.ray[idle] = self.waiting + np.arange(idle.size)
        self.waiting += idle.size
        self.place[idle] = self.height[idle] = 0
        return idle

    def _enter_nodes(self, lanes: Indices) -> None:
        """The nearest child that the ray meets becomes its place; the others go to the stack, the nearest on top."""
        tree, ray, node = self.tree, self.ray[lanes], self.place[lanes]
        bounds = columns(tree._bounds, node).reshape(6, WIDTH, -1)
        entry, met = slabs(bounds, self.slabs.take(ray, axis=1), self.nearest.t[ray])
        keys = entry.view(np.int64)
        keys &= ~CHILD
        keys |= columns(tree._child, node)
        np.copyto(keys, FAR, where=~met)
        ordered = list(keys)
        for i, j in SORTING_NETWORK:
            ordered[i], ordered[j] = np.minimum(ordered[i], ordered[j]), np.maximum(ordered[i], ordered[j])
        for key in ordered[:0:-1]:
            some = np.flatnonzero(key != FAR)
            if some.size:
                self._push(lanes[some], key[some])
        self.place[lanes] = np.where(ordered[0] == FAR, -1, ordered[0] & CHILD)

    def _push(self, lanes: Indices, key: Indices) -> None:
        height = self.height[lanes]
        self.stack[self.base[lanes] + height] = key
        self.height[lanes] = height + 1

    def _pop(self, lanes: Indices) -> Indices:
        """Sends lanes without a place to the top of their stack, leaving out what lies behind the hit they know;
        returns the lanes whose stack is empty."""
        done = []
        wanting = lanes[self.place[lanes] < 0]
        while wanting.size:
            height = self.height[wanting]
            empty = height == 0
            done.append(wanting[empty])
            wanting, height = wanting[~empty], height[~empty] - 1
            key = self.stack[self.base[wanting] + height]
            self.height[wanting] = height
            ahead = (key & ~CHILD).view(np.float64) <= self.nearest.t[self.ray[wanting]]
            self.place[wanting] = np.where(ahead, key & CHILD, -1)
            wanting = wanting[~ahead]
        return np.concatenate([np.zeros(0, np.int64), *done])

    def _test_leaves(self, lanes: Indices) -> None:
        tree, ray = self.tree, self.ray[lanes]
        leaf = self.place[lanes] - tree._nodes
        held = columns(tree._leaves, leaf)
        primitives = columns(tree._data, leaf + self.copies[ray]).reshape(-1, *held.shape)
        t = tree._primitives.distance(primitives, self.rays.take(ray, axis=1)[:, None])
        if self.left is not None:
            t[held == self.left[ray]] = np.inf
        first = t.min(axis=0)
        hit = np.flatnonzero((first <= self.nearest.t[ray]) & (first < np.inf))
        # Leaves hold their primitives in ascending order, so the first of equals has the lowest id.
        winner = held[t[:, hit].argmin(axis=0), hit]
        self.nearest.offer(ray[hit], first[hit], tree._primitive_id[winner])
        self.place[lanes] = -1
        if self.any_hit:
            self.height[lanes[self.nearest.primitive_id[ray] >= 0]] = 0


def columns(table: np.ndarray, rows: Indices) -> np.ndarray:
    """(k, n) some rows of a table (m, k), as columns."""
    return np.ascontiguousarray(table.take(rows, axis=0).T)


def slabs_of(origin: Array, direction: Array, extent: float, slack: float = 1.0) -> Array:
    """(9, n) what `slabs` wants of rays (3, n) among boxes of this extent, which are padded `slack` times as much as usual."""
    # A zero component becomes tiny: the padded slab then answers -huge and +huge, or twice the same, never NaN.
    safe = np.where(np.abs(direction) < 1e-300, 1e-300, direction)
    pad = 32.0 * slack * EPSILON * (np.abs(origin).max(axis=0) + extent) + 1e-300
    return np.ascontiguousarray(np.concatenate([origin + pad, origin - pad, 1.0 / safe]))


def slabs(bounds: Array, ray: Array, t_max: Array) -> tuple[Array, np.ndarray]:
    """Where rays (9, n) enter the boxes (6, 8, n), and which they meet in [0, t_max]; NaN bounds are never met.
    Overwrites `bounds`.

    The near side is moved towards the eye and the far side away by 8 units in the last place (Ize 2013: 2 suffice
    for a product rounded once).
    """
    near, far = np.zeros(bounds.shape[1:]), np.broadcast_to(t_max, bounds.shape[1:]).copy()
    for k in range(3):
        low, high = bounds[k], bounds[k + 3]
        low -= ray[k]
        low *= ray[k + 6]
        high -= ray[k + 3]
        high *= ray[k + 6]
        np.maximum(near, np.minimum(low, high), out=near)
        np.minimum(far, np.maximum(low, high), out=far)
    near *= 1.0 - 8.0 * EPSILON
    far *= 1.0 + 8.0 * EPSILON
    return near, near <= far
