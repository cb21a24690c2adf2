"""Whom a contestant's times are compared with: the one that the config names, another that differs in one factor, or the
baseline of the race.

A factor is an engine, accelerator, shader, sampler, precision or thread count; scene, size and machine are always equal. An
accelerator counts as part of its engine where the two engines have none in common.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from engines.choices import Choice
from harness.analysis.axes import unlabelled
from harness.analysis.equivalence import similarity
from harness.config.experiment import PREFERRED_BASELINES
from harness.store.results import Contestant, Results

FACTORS = ("engine", "accelerator", "shader", "sampler", "precision", "threads")
AA = "A/A"
"""What is between a contestant and its twin."""


class Baseline(NamedTuple):
    """Whom a contestant is compared with, and the factors in which the two differ."""

    contestant: Contestant
    factors: str


def engine_order(results: Results) -> list[str]:
    """Engines that were measured, the baseline first: the config's, numpy, numba, embree, others by name."""
    engines = sorted({c.settings.engine for c in results.contestants if c.done})
    return list(dict.fromkeys(name for name in (results.config.baseline, *PREFERRED_BASELINES, *engines) if name in engines))


def nearest_of_engine(contestant: Contestant, group: Iterable[Contestant], engine: str) -> Contestant | None:
    """The engine's contestant that shares the most settings: whose image is compared."""
    same = [c for c in group if c.settings.engine == engine and not c.settings.label]
    return max(same, key=lambda c: similarity(contestant, c), default=None)


def race_baseline(group: Iterable[Contestant], results: Results) -> Contestant | None:
    """The baseline of a race: of the engine that is first in `engine_order`, the contestant that has the first value, as the
    config writes them, of every axis."""
    order = engine_order(results)
    racing = [c for c in group if not c.settings.label]
    axes = {key: [getattr(one, key) for one in results.config.combinations] for key in FACTORS if key != "engine"}

    def place(one: Contestant) -> tuple[int, ...]:
        return order.index(one.settings.engine), *(_first(getattr(one.settings, key), values) for key, values in axes.items())

    return min(racing, key=place, default=None)


def _first(value: Any, written: Sequence[Any]) -> int:
    """The place of the first written value that a setting matches. A written choice matches one that has its options among
    others, and a written nothing every value."""

    def stands_for(one: Any) -> bool:
        if isinstance(one, Choice):
            return one.describe().items() <= value.describe().items()
        return one is None or one == value

    return next((place for place, one in enumerate(written) if stands_for(one)), len(written))


def baseline_of(contestant: Contestant, group: Sequence[Contestant], results: Results) -> Baseline | None:
    """None for the baseline of the race, and for an A/A twin whose original has no result.

    A twin is compared with the contestant that it repeats, a contestant of a pair as the config says. Others are compared with
    one that is a single factor apart and nearer to the baseline engine: of the engine that stands first in `engine_order`, of
    these the one that is fewest factors from the baseline engine, then the first by name. Where there is none, and within the
    baseline engine, with the baseline of the race, whatever is between the two.
    """
    if contestant.settings.label:
        same = [c for c in group if c.settings == unlabelled(contestant.settings)]
        return Baseline(same[0], AA) if same else None
    racing = [c for c in group if not c.settings.label and c is not contestant]
    named = _named(contestant, racing, results)
    if named is not None:
        return Baseline(named, " and ".join(factors(contestant, named, group)) or "none")
    order = engine_order(results)
    root = nearest_of_engine(contestant, group, order[0])

    def distance(one: Contestant) -> tuple[int, int]:
        return order.index(one.settings.engine), len(factors(one, root, group)) if root is not None else 0

    nearer = [c for c in racing if len(factors(contestant, c, group)) == 1 and distance(c) < distance(contestant)]
    found = race_baseline(group, results)
    if contestant.settings.engine != order[0] and nearer:
        found = min(nearer, key=lambda c: (distance(c), c.name))
    if found is None or found is contestant:
        return None
    return Baseline(found, " and ".join(factors(contestant, found, group)) or "none")


def factors(one: Contestant, other: Contestant, group: Iterable[Contestant]) -> list[str]:
    """The names of the factors in which two differ. `auto` of two engines is one setting, whatever options each has for it."""
    found = [factor for factor in FACTORS if getattr(one.settings, factor) != getattr(other.settings, factor)]
    if "engine" in found and "accelerator" in found:
        if one.settings.accelerator.name == other.settings.accelerator.name == "auto":
            found.remove("accelerator")
            return found
        theirs: dict[str, set[str]] = {one.settings.engine: set(), other.settings.engine: set()}
        for contestant in group:
            theirs.setdefault(contestant.settings.engine, set()).add(contestant.settings.accelerator.name)
        if not theirs[one.settings.engine] & theirs[other.settings.engine]:
            found.remove("accelerator")
    return found


def _named(contestant: Contestant, racing: Sequence[Contestant], results: Results) -> Contestant | None:
    """The nearest of those that the config's first pair of this contestant names."""
    for pair in results.config.pairs:
        found = [c for c in racing if _matches(pair.baseline.chosen, c)]
        if found and _matches(pair.contestant.chosen, contestant):
            return max(found, key=lambda c: similarity(contestant, c))
    return None


def _matches(side: Mapping[str, str | int], contestant: Contestant) -> bool:
    """Whether a contestant has the settings of one side of a pair; choices are named without their options."""

    def plain(key: str) -> Any:
        value = getattr(contestant.settings, key, None)
        return value.name if isinstance(value, Choice) else value

    return all(plain(key) == value for key, value in side.items())
