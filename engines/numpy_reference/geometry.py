"""The shapes of a scene as arrays: a table of all primitives in the scene's order, and one set for each kind.

The id of a primitive is its place in the order (shape, primitive), which is also how ties in t are settled. Faces
without area keep their id, but enter no set: they are never hit and never sampled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from engines.numpy_reference.shapes import SHAPES, Primitives
from engines.numpy_reference.vectors import Array, Indices
from engines.scene import Mesh, Shape

KINDS = tuple(dict.fromkeys(SHAPES.values()))
"""The classes of the registry; a kind of primitive is the place of its class here."""


class Geometry:
    """Per primitive id, (n,) each: `shape`, `primitive` (inside its shape), `material`, `kind`, and `index` in the set of
    its kind (-1 for a face without area). `sets` has one entry for each of `KINDS`, perhaps an empty one."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        kinds = [KINDS.index(SHAPES[type(shape)]) for shape in shapes]
        counts = [KINDS[kind].count(shape) for kind, shape in zip(kinds, shapes, strict=True)]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.shape = np.repeat(np.arange(len(shapes)), counts)
        self.primitive = np.arange(self.shape.size) - first[self.shape]
        self.material = np.zeros(self.shape.size, np.int64)
        for begin, end, shape in zip(first, first[1:], shapes, strict=False):
            self.material[begin:end] = shape.materials if isinstance(shape, Mesh) else shape.material
        self.kind = np.repeat(np.array(kinds, np.int64), counts)
        self.index = np.full(self.shape.size, -1)
        self.sets: list[Primitives] = []
        for number, kind in enumerate(KINDS):
            mine = [shape for shape in shapes if SHAPES[type(shape)] is kind]
            self.sets.append(kind(mine, np.flatnonzero(self.kind == number)))
            self.index[self.sets[-1].primitive_id] = np.arange(self.sets[-1].primitive_id.size)
        corners = np.concatenate([primitives.corners() for primitives in self.sets], axis=1)
        self.upper_corner: Array | None = corners.max(axis=1) if corners.size else None
        """(3,) upper corner of the box around all finite shapes, or None where there is none."""

    def by_kind(self, primitive_id: Indices) -> Iterator[tuple[Primitives, Indices, Indices]]:
        """For each kind among n primitives: its set, which of the n are of it, and their places in the set."""
        kind = self.kind[primitive_id]
        for number, primitives in enumerate(self.sets):
            lanes = np.flatnonzero(kind == number)
            if lanes.size:
                yield primitives, lanes, self.index[primitive_id[lanes]]
