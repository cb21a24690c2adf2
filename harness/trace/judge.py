"""What is wrong with an engine's answers: hits of another surface, misses, hits where there is nothing, leaks.

An answer that is not the exact one is right where it is that of a ray which rounding cannot tell from the given one: of one of
`AROUND` rays that are shifted sideways by `TOLERANCE` of the largest coordinate. So neighbours across an edge are both right,
and a miss at an outline is; at an edge that two faces share no shifted ray misses, and a miss there is wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.trace.rays import Rays
from harness.trace.truth import Array, Closest, Index, Truth, unit

TOLERANCE = 16 * 2.0**-23
"""Of the largest coordinate of scene and origin: some roundings in float32."""
AROUND = 8


class Faults(NamedTuple):
    """Of `checked` rays: hits of another surface or at another distance, misses where something is hit, hits where nothing
    is; and the relative errors of the distance of the hits that are right."""

    checked: int
    wrong: int
    missed: int
    false_hits: int
    errors: Array

    @property
    def total(self) -> int:
        return self.wrong + self.missed + self.false_hits


class Judge:
    """Exact answers to a sample of rays, with which answers of any number of engines are compared."""

    def __init__(self, truth: Truth, rays: Rays) -> None:
        self._truth, self._rays = truth, rays
        self.exact = truth.closest(*rays)
        size = np.maximum(np.abs(rays.origins).max(axis=1, initial=0.0), truth.largest)
        self._tolerance = TOLERANCE * size
        self._length = np.linalg.norm(rays.directions, axis=1)

    def hits(self, t: Array, shape: Index, primitive: Index) -> Faults:
        """Of closest hits as `engines.interface.Hits` has them."""
        exact, hit = self.exact, np.isfinite(t)
        item = np.where(hit, self._truth.item_of(shape, primitive), -1)
        right = ~hit & (exact.item < 0)
        right |= hit & (item == exact.item) & self._close(t, exact, np.arange(len(t)))
        unconfirmed = np.flatnonzero(~right)
        right[unconfirmed] = self._within_tolerance(unconfirmed, hit, t, item)
        wrong = ~right
        met = exact.item >= 0
        with np.errstate(invalid="ignore"):
            errors = np.abs(t - exact.t) / exact.t
        return Faults(
            len(t),
            int((wrong & hit & met).sum()),
            int((wrong & ~hit).sum()),
            int((wrong & hit & ~met).sum()),
            errors[right & hit & met],
        )

    def occlusions(self, blocked: NDArray[np.bool_]) -> Faults:
        """Of answers to whether anything lies before `t_max`."""
        met = self.exact.item >= 0
        wrong = blocked != met
        for index in np.flatnonzero(wrong):
            shifted = self._shifted(int(index))
            wrong[index] = not ((shifted.item >= 0) == blocked[index]).any()
        return Faults(len(blocked), 0, int((wrong & met).sum()), int((wrong & ~met).sum()), np.zeros(0))

    def _close(self, t: Array, exact: Closest, of: Index) -> NDArray[np.bool_]:
        """Whether distances are the exact ones, as far as a sideways shift by the tolerance can say."""
        good = np.flatnonzero(exact.item >= 0)
        found = np.zeros(len(t), bool)
        o, d = self._rays.origins[of[good]], self._rays.directions[of[good]]
        normal = self._truth.normals(exact.item[good], o + exact.t[good, None] * d)
        cosine = np.abs((normal * unit(d)).sum(axis=1))
        with np.errstate(invalid="ignore"):
            off = np.abs(t[good] - exact.t[good]) * self._length[of[good]]
        found[good] = off * np.maximum(cosine, 1e-6) <= 2 * self._tolerance[of[good]]
        return found

    def _shifted(self, index: int) -> Closest:
        """The exact answers to the ray and to those beside it."""
        o, d, t_max = (each[index] for each in self._rays)
        ahead = d / np.linalg.norm(d)
        across = np.eye(3)[np.abs(ahead).argmin()]
        one = unit(np.cross(ahead, across)[None])[0]
        other = np.cross(ahead, one)
        turns = 2 * math.pi * np.arange(AROUND)[:, None] / AROUND
        shifts = np.concatenate([np.zeros((1, 3)), np.cos(turns) * one + np.sin(turns) * other])
        count = len(shifts)
        ends = np.full(count, t_max)
        ends[1 : count // 2 + 1] += self._tolerance[index] / self._length[index]
        return self._truth.closest(o + self._tolerance[index] * shifts, np.tile(d, (count, 1)), ends)

    def _within_tolerance(self, unconfirmed: Index, hit: NDArray[np.bool_], t: Array, item: Index) -> list[bool]:
        """Whether answers are those of a shifted ray."""
        found = []
        for index in unconfirmed:
            shifted = self._shifted(int(index))
            if not hit[index]:
                found.append(bool((shifted.item < 0).any()))
                continue
            met = np.flatnonzero(shifted.item >= 0)
            same = Closest(shifted.t[met], shifted.item[met])
            close = self._close(np.full(len(met), t[index]), same, np.full(len(met), index))
            places = self._rays.origins[index] + same.t[:, None] * self._rays.directions[index]
            near = self._truth.distance(np.full(len(met), item[index]), places) <= 4 * self._tolerance[index]
            found.append(bool((close & (near | (same.item == item[index]))).any()))
        return found


def leaks(rays: Rays, t: Array) -> int:
    """How many of `rays.hard_rays` found nothing before their end."""
    return int((~(t <= rays.t_max)).sum())
