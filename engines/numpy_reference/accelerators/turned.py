"""Instances: rays go from one box to the next that they meet, and are turned into the coordinates of the group in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from engines.numpy_reference.accelerators.bvh import columns, slabs, slabs_of
from engines.numpy_reference.accelerators.bvh_build import WIDTH, Wide, build
from engines.numpy_reference.accelerators.nearest import Nearest, Part
from engines.numpy_reference.instances import Instances
from engines.numpy_reference.vectors import EPSILON, Array, Indices, Mask

STEP, PAIRS = 4096, 1 << 18
"""Rays that look for boxes together, and how many boxes they find at most: where there are more, fewer rays look together."""
WIDER = 1.0 + 8.0 * EPSILON
"""Searches in a group end so much later, as t is rounded on the way there and back."""


class _Met(NamedTuple):
    """Pairs of a ray and an instance whose box it meets, and t where it enters the box, rounded down; (k,) each."""

    ray: Indices
    instance: Indices
    entry: Array


class TurnedParts:
    """All instances of a scene. `groups` has the parts of each group, once; with `tree` boxes of instances are found through a
    tree, else every ray is turned for every instance."""

    def __init__(self, instances: Instances, groups: Sequence[Sequence[Part]], tree: bool) -> None:
        self._instances, self._groups = instances, groups
        self._tree: Wide | None = build(instances.low, instances.high, 1) if tree else None
        self.nbytes = sum(part.nbytes for parts in groups for part in parts)
        if self._tree is not None:
            nodes = self._tree.child.shape[1]
            self._boxes = np.ascontiguousarray(self._tree.bounds.reshape(-1, nodes).T)
            self._child = np.ascontiguousarray(self._tree.child.T)
            self.nbytes += self._boxes.nbytes + self._child.nbytes

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower id."""
        self._trace(origin, direction, nearest, check, any_hit=False)

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, before.t); overwrites `before`."""
        self._trace(origin, direction, before, check, any_hit=True)
        return before.primitive_id >= 0

    def _trace(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None], any_hit: bool) -> None:
        begin, step = 0, STEP
        while begin < nearest.t.size:
            rays = np.arange(begin, min(begin + step, nearest.t.size))
            met = self._met(rays, origin, direction, nearest.t, check)
            if met is None:
                step = max(1, step // 8)
                continue
            begin += rays.size
            order = np.lexsort((met.instance, met.entry, met.ray))
            ray, instance, entry = met.ray[order], met.instance[order], met.entry[order]
            turn = np.arange(ray.size) - np.searchsorted(ray, ray)  # the first box of each ray, then the second
            for number in range(int(turn.max(initial=-1)) + 1):
                check()
                wanted = (turn == number) & (entry <= nearest.t[ray])
                if any_hit:
                    wanted &= nearest.primitive_id[ray] < 0
                self._within(ray[wanted], instance[wanted], origin, direction, nearest, check)

    def _met(self, rays: Indices, origin: Array, direction: Array, t: Array, check: Callable[[], None]) -> _Met | None:
        """The boxes that rays meet; None where they are too many for more than one ray."""
        count = self._instances.group.size
        if self._tree is None:
            if rays.size * count > PAIRS and rays.size > 1:
                return None
            return _Met(np.repeat(rays, count), np.tile(np.arange(count), rays.size), np.zeros(rays.size * count))
        part = origin.take(rays, axis=1), direction.take(rays, axis=1)
        padded = slabs_of(*part, self._instances.extent, self._instances.slack)
        lane, node, found, pairs = np.arange(rays.size), np.zeros(rays.size, np.int64), list[_Met](), 0
        while lane.size:
            check()
            boxes = columns(self._boxes, node).reshape(6, WIDTH, -1)
            entry, met = slabs(boxes, padded.take(lane, axis=1), t[rays[lane]])
            slot, pair = np.nonzero(met)
            pairs += pair.size
            if pairs > PAIRS and rays.size > 1:
                return None
            child, lane, entry = columns(self._child, node)[slot, pair], lane[pair], entry[slot, pair]
            leaf = child - self._child.shape[0]
            at_leaf = leaf >= 0
            found.append(_Met(rays[lane[at_leaf]], self._tree.leaves[0, leaf[at_leaf]], entry[at_leaf]))
            lane, node = lane[~at_leaf], child[~at_leaf]
        return _Met(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def _within(
        self, ray: Indices, instance: Indices, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]
    ) -> None:
        """Looks for closer hits of distinct rays (n,) in one instance each (n,)."""
        of_group = self._instances.group[instance]
        for group in np.flatnonzero(np.bincount(of_group)).tolist():
            mine = of_group == group
            lanes, shown = ray[mine], instance[mine]
            start, way, length = self._instances.inwards(shown, origin.take(lanes, axis=1), direction.take(lanes, axis=1))
            first = self._instances.first[shown]
            inner = Nearest.before(nearest.t[lanes] * (length * WIDER), nearest.origin_primitive[lanes] - first)
            for part in self._groups[group]:
                part.closest(start, way, inner, check)
            hit = inner.primitive_id >= 0
            nearest.offer(lanes[hit], inner.t[hit] / length[hit], first[hit] + inner.primitive_id[hit])
