"""Whom a contestant's times are compared with: the baseline of its race; further, those that the config's pairs name and, along
each axis, the contestant that is equal in all else and has the first value.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from harness.analysis.axes import accelerators_of, differences, places, unlabelled
from harness.analysis.equivalence import similarity
from harness.config.experiment import PREFERRED_BASELINES
from harness.store.results import Contestant, Results

AA = "A/A"
"""What is between a contestant and its twin."""
SEVERAL = " and "
"""Between the names of the settings in which two contestants differ."""


class Baseline(NamedTuple):
    """Whom a contestant is compared with, and the settings in which the two differ."""

    contestant: Contestant
    factors: str


class Further(NamedTuple):
    """A further ratio: `axis` is the setting or option in which the two differ alone, and empty of a pair of the config, whose
    number is `pair`."""

    contestant: Contestant
    baseline: Contestant
    axis: str
    pair: int = -1


def engine_order(results: Results) -> list[str]:
    """Engines that were measured, the one whose images others are compared with first: the config's baseline, numpy, numba,
    embree, others by name."""
    engines = sorted({c.settings.engine for c in results.contestants if c.done})
    baseline = results.config.baseline
    condition = baseline.conditions.get("engine") if baseline is not None else None
    named = [engine for engine in engines if condition is not None and condition(engine)]
    return list(dict.fromkeys(name for name in (*named, *PREFERRED_BASELINES, *engines) if name in engines))


def nearest_of_engine(contestant: Contestant, group: Iterable[Contestant], engine: str) -> Contestant | None:
    """The engine's contestant that shares the most settings, options of the shader first: whose image is compared."""
    same = [c for c in group if c.settings.engine == engine and not c.settings.label]
    shader = contestant.settings.shader
    return max(same, key=lambda c: (c.settings.shader == shader, similarity(contestant, c)), default=None)


class Baselines:
    """Who is compared with whom in these results."""

    def __init__(self, results: Results) -> None:
        self.config = results.config
        self.places = places(results)
        self.engines = engine_order(results)
        self.accelerators = accelerators_of(one for one in results.contestants if one.done)

    def place(self, one: Contestant) -> tuple[int, int]:
        """What contestants are sorted by: the place in the config, where that does not tell them the engine."""
        return self.places[one.settings], self.engines.index(one.settings.engine)

    def factors(self, one: Contestant, other: Contestant) -> list[str]:
        """The settings, and options of choices, in which two contestants differ."""
        return differences(one.settings, other.settings, self.accelerators)

    def of_race(self, group: Iterable[Contestant]) -> Contestant | None:
        """The baseline of a race: of those that the config's `baseline` matches, else of all, the one that has the first value,
        as written, of every axis."""
        racing = [one for one in group if not one.settings.label]
        named = [one for one in racing if self.config.baseline is not None and self.config.baseline.matches(one.settings)]
        return min(named or racing, key=self.place, default=None)

    def of(self, contestant: Contestant, group: Sequence[Contestant]) -> Baseline | None:
        """An A/A twin is compared with the contestant that it repeats, others with the baseline of the race. None for that, and
        for a twin whose original has no result."""
        if contestant.settings.label:
            same = [one for one in group if one.settings == unlabelled(contestant.settings)]
            return Baseline(same[0], AA) if same else None
        found = self.of_race(group)
        if found is None or found is contestant:
            return None
        return Baseline(found, SEVERAL.join(self.factors(contestant, found)) or "none")

    def along_axes(self, group: Sequence[Contestant]) -> Iterator[Further]:
        """Every contestant of a scene, size, division and machine, with the one that differs from it in one axis alone and has
        the first value of those that do."""
        racing = sorted((one for one in group if not one.settings.label), key=self.place)
        for number, contestant in enumerate(racing):
            seen = set()
            for other in racing[:number]:
                between = self.factors(contestant, other)
                if len(between) == 1 and between[0] not in seen:
                    seen.add(between[0])
                    yield Further(contestant, other, between[0])

    def of_pairs(self, group: Sequence[Contestant]) -> Iterator[Further]:
        """Those of a race that the config's pairs name: of several on the side of the baseline the nearest."""
        racing = [one for one in group if not one.settings.label]
        for number, pair in enumerate(self.config.pairs):
            for contestant in [one for one in racing if pair.contestant.matches(one.settings)]:
                found = [one for one in racing if one is not contestant and pair.baseline.matches(one.settings)]
                if found:
                    nearest = max(found, key=lambda one, own=contestant: similarity(own, one))
                    yield Further(contestant, nearest, "", number)
