"""SD-trees (Müller, Gross and Novák 2017): from where how much light comes, at every place, as paths have found it.

A binary tree over space halves the scene's box at the middle, along x, y and z in turn. Each of its leaves has a quadtree over
directions: the square of (x, y) = ((1 + z)/2, phi/2 pi), whose areas are in proportion to solid angles. A *cell* is a quarter
of a quadtree's node that is not divided further. How paths use it: docs/transport.md, "Path guiding"; engines look the tree up
by functions of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int32]
Reals = NDArray[np.float64]

FIRST_END = 1
"""Samples per pixel of the first iteration. The others end when there are twice as many."""
UNGUIDED = 2
"""Iterations at first that only learn: after the first one, every place has the directions of the whole scene."""
DEEPEST = 20
"""Levels of a quadtree, at most."""
MOST_RECORDS = 16
"""Vertices of a path that are learned from, at most: its first ones."""
HALF_WORD = 31
UNIT, MOST = 2.0**-32, 2.0**30
"""Light is added up in whole numbers of `UNIT`, so that no order of adding changes a sum; what exceeds `MOST` counts as that.
The bits of a number up to `HALF_WORD` and those above have sums of their own."""
LOW, HIGH, COUNT = range(3)
"""What is added up of each cell: the two parts of light, and records."""


@dataclass(frozen=True)
class SDTree:
    """A tree of m inner nodes over space, and of n nodes over directions. The first nodes over directions are the roots of the
    leaves' quadtrees, in the order of leaves; children come after their parents."""

    corner: Reals
    """(3,) the lowest corner of the box."""
    size: Reals
    """(3,) its edges, above 0."""
    root: int
    """The first inner node, or -1 - leaf, as in `halves`."""
    halves: Indices
    """(m, 2) what the lower and the upper half are: an inner node, or -1 - leaf."""
    quarters: Indices
    """(n, 4) the node that divides a quarter, -1 for none. Quarter 1 has the larger x, 2 the larger y, 3 both."""
    densities: Reals
    """(n, 4) the share of its light in each quarter, over that of its solid angle."""
    shares: Reals
    """(n, 3) of the light in the node, the share of the quarters 0 and 2; of theirs that of 0; of that of 1 and 3 that of 1."""
    levels: tuple[int, ...]
    """Where the nodes of each level of quadtrees begin, and n."""

    @property
    def leaves(self) -> int:
        return self.levels[1]

    def empty_totals(self) -> NDArray[np.int64]:
        """(n, 4, 3) sums of nothing, of each quarter."""
        return np.zeros((*self.quarters.shape, 3), np.int64)


def planted(boxes: Sequence[tuple[Sequence[float], Sequence[float]]]) -> SDTree:
    """The tree that has learned nothing: one leaf, one node. `boxes` are (lowest, highest) corners of finite shapes, any
    number of them."""
    corners = np.array(boxes, np.float64).reshape(-1, 2, 3) if boxes else np.array([[[-1.0] * 3, [1.0] * 3]])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    size = np.maximum(high - low, max(1e-3 * (high - low).max(), 1e-9))
    none = np.zeros((0, 2), np.int32)
    return SDTree(low, size, -1, none, np.full((1, 4), -1, np.int32), np.ones((1, 4)), np.full((1, 3), 0.5), (0, 1))


def refined(tree: SDTree, totals: NDArray[np.int64], most_records: float, most_flux: float) -> SDTree:
    """The tree with the light of `totals` (n, 4, 3), as fine as that is known: leaves with more than `most_records` records are
    halved, quarters with more than the share `most_flux` of their quadtree's light are divided, and others are not."""
    flux = totals[..., HIGH] * (UNIT * 2.0**HALF_WORD) + totals[..., LOW] * UNIT
    records = totals[..., COUNT].astype(np.float64)
    for first, last in reversed(list(zip(tree.levels[1:-1], tree.levels[2:], strict=True))):
        parents = tree.quarters[:first]
        inner = (parents >= first) & (parents < last)
        flux[:first][inner] = flux[parents[inner]].sum(axis=1)
        records[:first][inner] = records[parents[inner]].sum(axis=1)
    per_leaf = records[: tree.leaves].sum(axis=1)
    halvings = np.ceil(np.log2(np.maximum(per_leaf / most_records, 1.0))).astype(np.int64)
    root, halves = _halved(tree, halvings)
    quarters, light, levels = _divided(tree, flux, np.repeat(np.arange(tree.leaves), 2**halvings), most_flux)
    densities, shares = _densities(light), _shares(light)
    return SDTree(tree.corner, tree.size, root, halves, quarters, densities, shares, levels)


def _halved(tree: SDTree, halvings: NDArray[np.int64]) -> tuple[int, Indices]:
    """(root, halves) of the tree over space where leaf j is replaced by a complete tree with 2^halvings[j] leaves, whose inner
    nodes are numbered as in a heap."""
    leaves, inner = 2**halvings, 2**halvings - 1
    first_leaf, first_inner = leaves.cumsum() - leaves, len(tree.halves) + inner.cumsum() - inner
    instead = np.where(halvings > 0, first_inner, -1 - first_leaf)
    of = np.repeat(np.arange(leaves.size), inner)
    heap = len(tree.halves) + np.arange(of.size) - first_inner[of] + 1
    below = 2 * heap[:, None] + np.arange(2)
    added = np.where(
        below < leaves[of, None], first_inner[of, None] + below - 1, leaves[of, None] - below - first_leaf[of, None] - 1
    )
    kept = np.where(tree.halves < 0, instead[-1 - tree.halves], tree.halves)
    root = int(instead[-1 - tree.root]) if tree.root < 0 else tree.root
    return root, np.concatenate([kept, added]).astype(np.int32)


def _divided(tree: SDTree, flux: Reals, roots: NDArray[np.int64], most_flux: float) -> tuple[Indices, Reals, tuple[int, ...]]:
    """(quarters, light in them, levels) of quadtrees like those of `roots`, divided anew by the light in their quarters. Light
    of a quarter that was not divided yet is spread evenly."""
    node, light, tree_light = roots, flux[roots], flux[roots].sum(axis=1)
    quarters, lights, levels = [], [light], [0, len(roots)]
    for level in range(DEEPEST):
        divides = (light > most_flux * tree_light[:, None]) & (level + 1 < DEEPEST)
        numbers = np.full(light.shape, -1, np.int32)
        numbers[divides] = levels[-1] + np.arange(divides.sum())
        quarters.append(numbers)
        if not divides.any():
            break
        parent = np.nonzero(divides)[0]
        node = np.where(node[:, None] < 0, -1, tree.quarters[node])[divides]
        light = np.where(node[:, None] < 0, light[divides][:, None] / 4.0, flux[node])
        tree_light = tree_light[parent]
        lights.append(light)
        levels.append(levels[-1] + len(node))
    return np.concatenate(quarters), np.concatenate(lights), tuple(levels)


def _densities(light: Reals) -> Reals:
    """(n, 4) as in `SDTree`; 1 where there is no light."""
    total = light.sum(axis=1, keepdims=True)
    return np.where(total > 0.0, 4.0 * light / np.where(total > 0.0, total, 1.0), 1.0)


def _shares(light: Reals) -> Reals:
    """(n, 3) shares, as in `SDTree`, of quarters (n, 4); halves where there is no light."""
    columns = light[:, 0] + light[:, 2], light[:, 1] + light[:, 3]
    pairs = (columns[0], columns[1]), (light[:, 0], light[:, 2]), (light[:, 1], light[:, 3])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([np.where(a + b > 0.0, a / (a + b), 0.5) for a, b in pairs], axis=1)


class Training:
    """A tree that learns from iteration to iteration. An iteration looks up the tree as those before have left it, and adds up
    what it finds in `totals`."""

    def __init__(self, boxes: Sequence[tuple[Sequence[float], Sequence[float]]], most_records: float, most_flux: float) -> None:
        self._boxes, self._most_records, self._most_flux = boxes, most_records, most_flux
        self.restart()

    def restart(self) -> None:
        """Forgets everything."""
        self.iteration = 0
        self.tree = planted(self._boxes)
        self.totals = self.tree.empty_totals()

    @property
    def end(self) -> int:
        """Samples per pixel at which the iteration ends."""
        return FIRST_END << self.iteration

    @property
    def guides(self) -> bool:
        """Whether directions are sampled by the tree in this iteration."""
        return self.iteration >= UNGUIDED

    def advance(self) -> None:
        """Ends the iteration: the tree takes what has been added up."""
        self.tree = refined(self.tree, self.totals, self._most_records * 2.0 ** (self.iteration / 2), self._most_flux)
        self.totals = self.tree.empty_totals()
        self.iteration += 1
