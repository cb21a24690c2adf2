"""What prose may ask of the results, by the names of `Facts.vocabulary`.

A phrase names configurations by their words, with commas: `sphereflake, embree, 1 thread`. What it leaves open is filled from
the `usual` words, in their order; one configuration must be left. Several phrases in a list mean that something holds of each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from engines.errors import ConfigError
from harness.analysis import Analysis, error_targets
from harness.report.chapter import experiment, measures
from harness.report.chapter.families import AXES, SPEEDS, Family, Measure, best, compare, families, thousands, words
from harness.statistics import Estimate, Ratio
from harness.store.results import Contestant

T = TypeVar("T")
Where = str | Sequence[str]
Measuring = Callable[[Analysis, Family], Measure]


class Facts:
    """The results of one or more experiments, each scene in one of them."""

    def __init__(self, analyses: Sequence[Analysis], usual: Sequence[str] = ()) -> None:
        self._usual = usual
        self._contestants = [(analysis, set(named.values()), one) for analysis in analyses for named, one in words(analysis)]
        self._families = [(analysis, family) for analysis in analyses for axis in AXES for family in families(analysis, axis)]

    def vocabulary(self) -> Mapping[str, Callable[..., Any]]:
        """The functions that prose may call."""
        compared = {
            "faster": (_speeds, "faster"),
            "same_speed": (_speeds, "same"),
            "less_error": (_errors, "faster"),
            "same_error": (_errors, "same"),
            "sooner": (_times, "faster"),
            "same_time": (_times, "same"),
        }
        ratios = {"speedup": _speeds, "error_ratio": _errors, "time_ratio": _times}
        return {
            **{name: self._claim(*how) for name, how in compared.items()},
            **{name: self._ratios(how) for name, how in ratios.items()},
            "fastest": self.fastest,
            "speed": self._of(lambda a, c: thousands(c)),
            "cost": self._of(lambda a, c: experiment.nanoseconds(c)),
            "build": self._of(measures.build_milliseconds),
            "error": self.error,
            "tail_share": self.tail_share,
            "target": self.target,
            "spp": self.spp,
            "primitives": self._of(lambda a, c: experiment.primitives(c)),
            "cells": self._of(_cells),
            "contended": self._of(lambda a, c: experiment.contended_cells(a)),
            "noise_floor": self._of(_floor),
            "blocks": self._of(lambda a, c: len({cell.block for cell in c.done})),
            "place": self._of(_place),
            "low": lambda found: min(one.low for one in _each(found)),
            "high": lambda found: max(one.high for one in _each(found)),
            "least": lambda found: min(one[0] for one in _each(found)),
            "most": lambda found: max(one[0] for one in _each(found)),
        }

    # ---- one configuration -------------------------------------------------------------------------------------------

    def _one(self, phrase: str) -> tuple[Analysis, Contestant]:
        found = [(analysis, one) for analysis, _, one in self._chosen(phrase, self._contestants, lambda each: each[1])]
        if len(found) == 1:
            return found[0]
        raise ConfigError(f"{phrase!r} names {_number([one.name for _, one in found], 'configuration')}: one is expected")

    def _chosen(self, phrase: str, every: Iterable[T], words_of: Callable[[T], set[str]]) -> list[T]:
        """Those that have all words of the phrase, narrowed by each of the usual words that some of them have."""
        wanted = {word.strip() for word in phrase.split(",")}
        found = [one for one in every if wanted <= words_of(one)]
        for word in self._usual:
            found = [one for one in found if word in words_of(one)] or found
        return found

    def _of(self, function: Callable[[Analysis, Contestant], Any]) -> Callable[[str], Any]:
        return lambda phrase: function(*self._one(phrase))

    def error(self, phrase: str, spp: int) -> Estimate:
        """relMSE of all pixels at a number of samples, not corrected for the reference's noise."""
        return measures.errors_untrimmed_and_trimmed(*self._one(phrase), spp)[0]

    def tail_share(self, phrase: str, spp: int) -> float:
        """Per cent of relMSE that the worst 0.1 % of the pixels hold."""
        analysis, one = self._one(phrase)
        whole, trimmed = measures.errors_untrimmed_and_trimmed(analysis, one, spp)
        return 100 * measures.share_of_the_worst(whole.value, trimmed.value, measures.pixels(one))

    # ---- pairs -------------------------------------------------------------------------------------------------------

    def _family(self, phrase: str, *members: str) -> tuple[Analysis, Family]:
        every = [(analysis, family) for analysis, family in self._families if set(members) <= set(family.members)]
        found = self._chosen(phrase, every, lambda each: set(each[1].held.values()))
        if len(found) == 1:
            return found[0]
        held = [", ".join(family.held.values()) for _, family in found]
        raise ConfigError(f"{phrase!r} with {' and '.join(members)} names {_number(held, 'comparison')}: one is expected")

    def _compared(self, phrase: str, one: str, other: str, measuring: Measuring) -> Ratio:
        analysis, family = self._family(phrase, one, other)
        return compare(analysis, family, one, other, measuring(analysis, family))

    def _ratios(self, measuring: Measuring) -> Callable[[Where, str, str], Any]:
        """How many times better the first is: by speed, error or time to the hardest common target."""

        def ratios(where: Where, one: str, other: str) -> Any:
            found = [self._compared(phrase, one, other, measuring) for phrase in _phrases(where)]
            return found[0] if isinstance(where, str) else found

        return ratios

    def _claim(self, measuring: Measuring, verdict: str) -> Callable[[Where, str, str], Verdicts]:
        def claim(where: Where, one: str, other: str) -> Verdicts:
            found = {phrase: self._compared(phrase, one, other, measuring) for phrase in _phrases(where)}
            return Verdicts(found, verdict)

        return claim

    def fastest(self, where: Where, one: str) -> bool:
        """Whether nothing else of its family may be the fastest, in each of the places."""
        return all(best(*self._family(phrase, one)) == [one] for phrase in _phrases(where))

    def target(self, phrase: str, member: str) -> float:
        """The hardest target that all of a family reach with every seed."""
        analysis, family = self._family(phrase, member)
        index = measures.hardest_target(analysis, family)
        return math.nan if index is None else error_targets(analysis.results)[index]

    def spp(self, phrase: str, member: str) -> int:
        """The samples per pixel at which errors of a family are compared."""
        _, family = self._family(phrase, member)
        return measures.common_spp(list(family.members.values())) or 0


class Verdicts:
    """Ratios by phrase; true where each has the verdict."""

    def __init__(self, ratios: Mapping[str, Ratio], verdict: str) -> None:
        self.ratios, self.verdict = ratios, verdict

    def __bool__(self) -> bool:
        return all(ratio.verdict == self.verdict for ratio in self.ratios.values())


def _speeds(analysis: Analysis, family: Family) -> Measure:
    return SPEEDS


def _errors(analysis: Analysis, family: Family) -> Measure:
    return measures.errors_at(analysis, measures.common_spp(list(family.members.values())))


def _times(analysis: Analysis, family: Family) -> Measure:
    index = measures.hardest_target(analysis, family)
    if index is None:
        raise ConfigError(f"{', '.join(family.held.values())}: there is no target that all reach with every seed")
    return measures.times_to(analysis, family, index)


def _cells(analysis: Analysis, contestant: Contestant) -> int:
    return len(analysis.results.cells)


def _floor(analysis: Analysis, contestant: Contestant) -> float:
    """Per cent."""
    return 100 * math.expm1(analysis.floor(contestant.settings.scene))


def _place(analysis: Analysis, contestant: Contestant) -> str:
    return experiment.place(analysis)[0]


def _phrases(where: Where) -> Sequence[str]:
    return [where] if isinstance(where, str) else where


def _each(found: Any) -> Sequence[Any]:
    return found if isinstance(found, list) else [found]


def _number(names: Sequence[str], noun: str) -> str:
    shown = f" ({'; '.join(names[:4])}{'; ...' if len(names) > 4 else ''})" if names else ""
    return f"{len(names) or 'no'} {noun}s{shown}"
