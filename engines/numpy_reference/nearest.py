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
    flat: bool
    """Whether a ray that leaves one cannot meet it again."""

    def rays(self, origin: Array, direction: Array) -> tuple[Indices, Array]:
        """Which of the copies in `data` serves each ray (n,), and what `distance` wants of it (k, n)."""
        ...

    def distance(self, primitive: Any, ray: Any, /) -> Array:
        """t > 0 of the hit, inf for a miss; the arguments broadcast after their first axis."""
        ...


class Part(Protocol):
    """What finds hits on some of the primitives: a list or a tree of one kind."""

    nbytes: int

    def closest(self, origin: Array, direction: Array, nearest: Nearest, check: Callable[[], None]) -> None:
        """Takes over into `nearest` what lies closer, or as close with a lower rank."""
        ...

    def occluded(self, origin: Array, direction: Array, before: Nearest, check: Callable[[], None]) -> Mask:
        """(n,) whether anything lies in (0, before.t); may overwrite `before`."""
        ...


class Nearest(NamedTuple):
    """Per ray: `t`, at first the open upper end of the search, and `rank` of the primitive there, -1 for none. `left` is
    the rank of what the ray has just left, -1 for none: a flat primitive is not met again, whatever rounding says."""

    t: Array
    rank: Indices
    left: Indices

    @classmethod
    def before(cls, t_max: Array, left: Indices | None = None) -> Nearest:
        """Nothing found yet; hits at t_max or beyond will not be taken."""
        none = np.full(t_max.size, -1)
        return cls(t_max.astype(np.float64), none, none.copy() if left is None else left)

    def take(self, lanes: Indices) -> Nearest:
        """What some of the rays have found."""
        return Nearest(self.t[lanes], self.rank[lanes], self.left[lanes])

    def left_among(self, primitives: Primitives) -> Indices | None:
        """(n,) which of the primitives each ray has left, -1 for none; None where that is so for all, or need not be known."""
        if not primitives.flat or not (self.left >= 0).any():
            return None
        place = np.minimum(np.searchsorted(primitives.rank, self.left), primitives.rank.size - 1)
        return np.where(primitives.rank[place] == self.left, place, -1)

    def offer(self, lanes: Indices, t: Array, rank: Indices) -> None:
        """Takes the hit (t, rank) of each of the distinct `lanes` where it wins: by t, then by rank."""
        known = self.t[lanes]
        wins = (t < known) | ((t == known) & (rank < self.rank[lanes]))
        lanes = lanes[wins]
        self.t[lanes], self.rank[lanes] = t[wins], rank[wins]
