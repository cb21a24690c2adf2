"""The shapes of a scene as arrays: a table of all primitives, and one set for each kind.

The id of a primitive is its place in the order (shape, primitive), which is also how ties in t are settled; an instance has all
primitives of its group. Faces without area keep their id, but enter no set: they are never hit and never sampled. The tables
hold the primitives of a group once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from engines.numpy_reference.instances import Instances, Turned
from engines.numpy_reference.shapes import SHAPES, Primitives
from engines.numpy_reference.vectors import Array, Indices
from engines.scene import Instance, Mesh, Shape, groups_of

KINDS = tuple(dict.fromkeys(SHAPES.values()))
"""The classes of the registry; a kind of primitive is the place of its class here."""


class Geometry:
    """Per row, (m,) each: `material`, `kind`, and `index` in the set of its kind (-1 for a face without area); `single`, the
    place of its shape among `engines.scene.singles`. `sets` has one entry for each of `KINDS`, perhaps an empty one.

    Rows are the primitives of shapes that are no instances, in order, and have a `shape` and a `primitive_id`, too; behind them
    come those of `groups`, whose kinds go on: those of group g begin at (g + 1) len(KINDS). `count` is that of all ids.
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        groups = groups_of(shapes)
        self.groups = [Geometry(group.shapes) for group in groups]
        number = {id(group): place for place, group in enumerate(groups)}
        of_group = np.array([number[id(shape.group)] if isinstance(shape, Instance) else -1 for shape in shapes], np.int64)
        own = [(shape, KINDS.index(SHAPES[type(shape)])) for shape in shapes if not isinstance(shape, Instance)]
        places, shown = np.flatnonzero(of_group < 0), np.flatnonzero(of_group >= 0)
        # ids of all shapes
        counts, held = np.zeros(len(shapes), np.int64), np.array([group.count for group in self.groups], np.int64)
        counts[places], counts[shown] = [KINDS[kind].count(shape) for shape, kind in own], held[of_group[shown]]
        self._first = np.concatenate([[0], np.cumsum(counts)])
        self.count = int(self._first[-1])
        # rows
        counts = counts[places]
        rows = np.concatenate([[0], np.cumsum(counts)])
        self._row = np.zeros(len(shapes), np.int64)
        self._row[places], self._row[shown] = rows[:-1], (rows[-1] + np.cumsum(held) - held)[of_group[shown]]
        self.shape = np.repeat(places, counts)
        self.primitive_id = np.arange(self.shape.size) + np.repeat(self._first[places] - rows[:-1], counts)
        self.single = np.repeat(np.arange(len(own)), counts)
        self.material = np.zeros(self.shape.size, np.int64)
        for (shape, _), begin, end in zip(own, rows, rows[1:], strict=False):
            self.material[begin:end] = shape.materials if isinstance(shape, Mesh) else shape.material
        self.kind = np.repeat(np.array([kind for _, kind in own], np.int64), counts)
        self.index = np.full(self.shape.size, -1)
        self.sets: list[Primitives] = []
        for kind, verbs in enumerate(KINDS):
            mine = [shape for shape, its in own if its == kind]
            self.sets.append(verbs(mine, self.primitive_id[self.kind == kind]))
            good = np.searchsorted(self.primitive_id, self.sets[-1].primitive_id)
            self.index[good] = np.arange(good.size)
        # instances, and the rows of groups
        self.instances: Instances | None = None
        if shown.size:
            instances = [shape for shape in shapes if isinstance(shape, Instance)]
            self.instances = Instances(instances, shown, self._first[shown], of_group[shown])
            self.material = np.concatenate([self.material, *(group.material for group in self.groups)])
            self.index = np.concatenate([self.index, *(group.index for group in self.groups)])
            held = len(own) + np.cumsum([0, *(len(group.shapes) for group in groups)])
            self.single = np.concatenate([self.single, *(g.single + at for g, at in zip(self.groups, held, strict=False))])
            kinds = (group.kind + (place + 1) * len(KINDS) for place, group in enumerate(self.groups))
            self.kind = np.concatenate([self.kind, *kinds])
        corners = np.concatenate([primitives.corners() for primitives in self.sets], axis=1)
        if self.instances is not None:
            corners = np.concatenate([corners, self.instances.high], axis=1)
        self.upper_corner: Array | None = corners.max(axis=1) if corners.size else None
        """(3,) upper corner of the box around all finite shapes, or None where there is none."""

    def place(self, primitive_id: Indices) -> tuple[Indices, Indices]:
        """(n,) shapes of primitives, and the number of each within its shape."""
        shape = np.searchsorted(self._first, primitive_id, side="right") - 1
        return shape, primitive_id - self._first[shape]

    def row(self, primitive_id: Indices) -> Indices:
        """(n,) rows of primitives."""
        if self.instances is None:
            return primitive_id
        shape, primitive = self.place(primitive_id)
        return self._row[shape] + primitive

    def by_kind(self, primitive_id: Indices) -> Iterator[tuple[Primitives | Turned, Indices, Indices]]:
        """For each kind among n primitives: its set, which of the n are of it, and their places in the set. What instances show
        is a set of turned primitives, whose verbs take these n alone."""
        row = self.row(primitive_id)
        kind = self.kind[row]
        for number in np.flatnonzero(np.bincount(kind)).tolist():
            lanes = np.flatnonzero(kind == number)
            index = self.index[row[lanes]]
            group, own = divmod(number, len(KINDS))
            if group == 0:
                yield self.sets[own], lanes, index
            else:
                assert self.instances is not None
                instance = self.instances.of_shape(self.place(primitive_id[lanes])[0])
                yield Turned(self.groups[group - 1].sets[own], self.instances, instance), lanes, index
