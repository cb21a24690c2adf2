"""Finds the closest hit among all kinds of primitives, each through an accelerator of its own; what has no bounds is a list."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from engines.choices import Choice
from engines.numpy_reference.accelerators.bvh import Bvh
from engines.numpy_reference.accelerators.exhaustive import Exhaustive
from engines.numpy_reference.accelerators.nearest import Nearest, Part
from engines.numpy_reference.accelerators.turned import TurnedParts
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.vectors import EPSILON, Array, Indices

OFFSET_ULPS = 256.0
AUTO_LIMIT = 48
"""Bounded primitives up to which `auto` takes `none`: about where both were measured to be equally fast."""


class Tracer:
    """Rays against the geometry. `accelerator` is `auto`, `none` or `bvh`, with its options; afterwards what was taken.

    `parts` can be given where another tracer finds the triangles; `epsilon` is then that of its arithmetic.
    """

    def __init__(
        self, geometry: Geometry, accelerator: Choice, parts: Sequence[Part] | None = None, epsilon: float = EPSILON
    ) -> None:
        self.accelerator = resolved_accelerator(accelerator, geometry)
        self.offset = OFFSET_ULPS * epsilon
        """How far rays start from a surface, as a share of the largest coordinate; shadow rays end as much early."""
        self._parts = _parts(geometry, self.accelerator) if parts is None else parts
        self.nbytes = sum(part.nbytes for part in self._parts)

    def closest(
        self, origin: Array, direction: Array, t_max: Array, check: Callable[[], None], origin_primitive: Indices | None = None
    ) -> Nearest:
        """Closest hits in (0, t_max) of rays (3, n) with unit directions. `check` is called every few milliseconds;
        `origin_primitive` (n,) are the ids of what the rays have left, -1 for none."""
        nearest = Nearest.before(t_max, origin_primitive)
        with np.errstate(all="ignore"):
            for part in self._parts:
                part.closest(origin, direction, nearest, check)
        nearest.t[nearest.primitive_id < 0] = np.inf
        return nearest

    def occluded(
        self, origin: Array, direction: Array, t_max: Array, check: Callable[[], None], origin_primitive: Indices | None = None
    ) -> np.ndarray:
        """(n,) whether anything lies in (0, t_max) but what was left."""
        dark, before = np.zeros(t_max.size, bool), Nearest.before(t_max, origin_primitive)
        with np.errstate(all="ignore"):
            for part in self._parts:
                lit = np.flatnonzero(~dark)
                rays = origin.take(lit, axis=1), direction.take(lit, axis=1)
                dark[lit] = part.occluded(*rays, before.take(lit), check)
        return dark


def _parts(geometry: Geometry, accelerator: Choice) -> list[Part]:
    found: list[Part] = []
    for primitives in geometry.sets:
        if primitives.primitive_id.size:
            tree = accelerator.name == "bvh" and primitives.bounded
            found.append(Bvh(primitives, accelerator.options["leaf_size"]) if tree else Exhaustive(primitives))
    if geometry.instances is not None:
        groups = [_parts(group, accelerator) for group in geometry.groups]
        found.append(TurnedParts(geometry.instances, groups, accelerator.name == "bvh"))
    return found


def resolved_accelerator(choice: Choice, geometry: Geometry) -> Choice:
    """What `auto` stands for in this scene; any other choice as it is."""
    if choice.name != "auto":
        return choice
    bounded = geometry.count - sum(primitives.primitive_id.size for primitives in geometry.sets if not primitives.bounded)
    return Choice("none") if bounded <= AUTO_LIMIT else Choice("bvh", {"leaf_size": 4})
