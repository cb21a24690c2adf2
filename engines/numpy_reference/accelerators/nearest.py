"""The closest hit so far of many rays, and what an accelerator has to answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.shapes import Primitives
from engines.numpy_reference.vectors import Array, Indices, Mask


class Part(Protocol):
    """What finds hits on some of the primitives: a list or a tree of one kind."""

    nbytes: int

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower id."""
        ...

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, before.t); may overwrite `before`."""
        ...


class Nearest(NamedTuple):
    """Per ray: `t`, at first the open upper end of the search, and the id of the primitive there, -1 for none.
    `origin_primitive` is the one that the ray has just left, -1 for none: one that is planar is not met again, whatever
    rounding says."""

    t: Array
    primitive_id: Indices
    origin_primitive: Indices

    @classmethod
    def before(cls, t_max: Array, origin_primitive: Indices | None = None) -> Nearest:
        """Nothing found yet; hits at t_max or beyond will not be taken."""
        none = np.full(t_max.size, -1)
        return cls(t_max.astype(np.float64), none, none.copy() if origin_primitive is None else origin_primitive)

    def take(self, lanes: Indices) -> Nearest:
        """What some of the rays have found."""
        return Nearest(self.t[lanes], self.primitive_id[lanes], self.origin_primitive[lanes])

    def origins_among(self, primitives: Primitives) -> Indices | None:
        """(n,) which of the primitives each ray has left, -1 for none; None where that is so for all, or need not be known."""
        left, ids = self.origin_primitive, primitives.primitive_id
        if not primitives.planar or not (left >= 0).any():
            return None
        place = np.minimum(np.searchsorted(ids, left), ids.size - 1)
        return np.where(ids[place] == left, place, -1)

    def offer(self, lanes: Indices, t: Array, primitive_id: Indices) -> None:
        """Takes the hit (t, id) of each of the distinct `lanes` where it wins: by t, then by id."""
        known = self.t[lanes]
        wins = (t < known) | ((t == known) & (primitive_id < self.primitive_id[lanes]))
        lanes = lanes[wins]
        self.t[lanes], self.primitive_id[lanes] = t[wins], primitive_id[wins]
