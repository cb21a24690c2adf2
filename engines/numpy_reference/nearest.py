"""The closest hit so far of many rays, and what an accelerator needs to know of a kind of primitive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.vectors import Array, Indices, Mask


class Primitives(Protocol):
    """One kind of primitive, m of them. Each is stored in `data` (copies, k, m) once for each way to test it."""

    data: Array
    rank: Indices

    def rays(self, origin: Array, direction: Array) -> tuple[Indices, Array]:
        """Which of the copies in `data` serves each ray (n,), and what `distance` wants of it (k, n)."""
        ...

    def distance(self, primitive: Any, ray: Any) -> Array:
        """t > 0 of the hit, inf for a miss; the arguments broadcast after their first axis."""
        ...


class Part(Protocol):
    """What finds hits on some of the primitives: a list or a tree of one kind."""

    nbytes: int

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower rank."""
        ...

    def occluded(self, origin: Array, direction: Array, t_max: Array, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, t_max)."""
        ...


class Nearest(NamedTuple):
    """Per ray: `t`, at first the open upper end of the search, and `rank` of the primitive there, -1 for none."""

    t: Array
    rank: Indices

    @classmethod
    def before(cls, t_max: Array) -> Nearest:
        """Nothing found yet; hits at t_max or beyond will not be taken."""
        return cls(t_max.astype(np.float64), np.full(t_max.size, -1))

    def offer(self, lanes: Indices, t: Array, rank: Indices) -> None:
        """Takes the hit (t, rank) of each of the distinct `lanes` where it wins: by t, then by rank."""
        known = self.t[lanes]
        wins = (t < known) | ((t == known) & (rank < self.rank[lanes]))
        lanes = lanes[wins]
        self.t[lanes], self.rank[lanes] = t[wins], rank[wins]
