"""What results say, in the words of a text about them: plain functions for its template, and for assertions.

A phrase names configurations by their words, with commas: `sphereflake, embree, 1 thread`. What it leaves open is filled from
the `usual` words, in their order; one configuration must be left. Several phrases in a list mean that something holds of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from engines.errors import ConfigError
from harness.analysis import Analysis
from harness.analysis.equivalence import common_spp
from harness.analysis.scaling import primitives
from harness.report.chapter import experiment, measures
from harness.report.chapter.families import (
    AXES,
    SPEEDS,
    Family,
    Measure,
    best,
    compare,
    families_along,
    named_contestants,
    pixels,
    thousands,
)
from harness.report.chapter.texts import interval
from harness.report.tables.model import number_text
from harness.statistics import Estimate, Ratio
from harness.store.results import Contestant

T = TypeVar("T")
Where = str | Sequence[str]
Measuring = Callable[[Analysis, Family], Measure]


class Facts:
    """The results of one or more experiments, each scene in one of them."""

    def __init__(self, analyses: Sequence[Analysis], usual: Sequence[str] = ()) -> None:
        self._usual = usual
        self._contestants = [
            (analysis, set(named.values()), one) for analysis in analyses for named, one in named_contestants(analysis)
        ]
        self._families = [
            (analysis, family) for analysis in analyses for axis in AXES for family in families_along(analysis, axis)
        ]

    # ---- one configuration -------------------------------------------------------------------------------------------

    def _one(self, phrase: str) -> tuple[Analysis, Contestant]:
        chosen = [(analysis, one) for analysis, _, one in self._chosen(phrase, self._contestants, lambda each: each[1])]
        return _only(chosen, repr(phrase), [one.name for _, one in chosen], "configuration")

    def _chosen(self, phrase: str, every: Iterable[T], words_of: Callable[[T], set[str]]) -> list[T]:
        """Those that have all words of the phrase, narrowed by each of the usual words that some of them have."""
        named = {word.strip() for word in phrase.split(",")}
        chosen = [one for one in every if named <= words_of(one)]
        for word in self._usual:
            chosen = [one for one in chosen if word in words_of(one)] or chosen
        return chosen

    def speed(self, phrase: str) -> Estimate:
        """Thousands of paths per second."""
        return thousands(self._one(phrase)[1])

    def build(self, phrase: str) -> Estimate:
        """Milliseconds of a build in a warm process."""
        return measures.build_milliseconds(*self._one(phrase))

    def error(self, phrase: str, spp: int) -> Estimate:
        """relMSE of all pixels at a number of samples, not corrected for the reference's noise."""
        return measures.errors_untrimmed_and_trimmed(*self._one(phrase), spp)[0]

    def tail_share(self, phrase: str, spp: int) -> float:
        """Per cent of relMSE that the worst 0.1 % of the pixels hold."""
        analysis, one = self._one(phrase)
        whole, trimmed = measures.errors_untrimmed_and_trimmed(analysis, one, spp)
        return 100 * measures.share_of_the_worst(whole.value, trimmed.value, pixels(one))

    def primitives(self, phrase: str) -> int:
        """Primitives of its scene."""
        return primitives(self._one(phrase)[1])

    def blocks(self, phrase: str) -> int:
        """Blocks in which it was measured."""
        return len({cell.block for cell in self._one(phrase)[1].done})

    def cells(self, phrase: str) -> int:
        """Cells of its experiment."""
        return len(self._one(phrase)[0].results.cells)

    def contended(self, phrase: str) -> int:
        """Cells of its experiment that shared the machine with other work while they were timed."""
        return experiment.contended_cells(self._one(phrase)[0])

    def persistent_spread(self, phrase: str) -> float:
        """Of the machine it was measured on, in per cent: what persists between equal configurations."""
        analysis, one = self._one(phrase)
        return 100 * analysis.spread(one).share

    def place(self, phrase: str) -> str:
        """On what machine it was measured, and when: a sentence."""
        return experiment.place(self._one(phrase)[0])[0]

    # ---- pairs -------------------------------------------------------------------------------------------------------

    def _family(self, phrase: str, *members: str) -> tuple[Analysis, Family]:
        every = [(analysis, family) for analysis, family in self._families if set(members) <= set(family.members)]
        chosen = self._chosen(phrase, every, lambda each: set(each[1].held.values()))
        held = [", ".join(family.held.values()) for _, family in chosen]
        return _only(chosen, f"{phrase!r} with {' and '.join(members)}", held, "comparison")

    def _compared(self, phrase: str, one: str, other: str, measuring: Measuring) -> Ratio:
        analysis, family = self._family(phrase, one, other)
        return compare(analysis, family, one, other, measuring(analysis, family))

    def _ratios(self, where: Where, one: str, other: str, measuring: Measuring) -> Ratios:
        return Ratios({phrase: self._compared(phrase, one, other, measuring) for phrase in _phrases(where)})

    def speedup(self, where: Where, one: str, other: str) -> Ratios:
        """How many times as fast the one is, per sample."""
        return self._ratios(where, one, other, lambda analysis, family: SPEEDS)

    def error_ratio(self, where: Where, one: str, other: str) -> Ratios:
        """How many times as large the other's error is, at the most samples that all of the family have."""
        return self._ratios(where, one, other, _errors)

    def time_ratio(self, where: Where, one: str, other: str) -> Ratios:
        """How many times as long the other takes to the hardest target that all of the family reach with every seed."""
        return self._ratios(where, one, other, _times)

    def fastest(self, where: Where, one: str) -> bool:
        """Whether nothing else of its family may be the fastest, in each of the places."""
        return all(best(*self._family(phrase, one)) == [one] for phrase in _phrases(where))


class Ratios:
    """How many times better one is than another, in each place. As text, the ratio with its interval, or of several the least
    and the greatest."""

    def __init__(self, ratios: Mapping[str, Ratio]) -> None:
        self.ratios = ratios

    @property
    def better(self) -> bool:
        """Whether the one is better in every place."""
        return all(ratio.verdict == "faster" for ratio in self.ratios.values())

    @property
    def least(self) -> float:
        return min(ratio.ratio for ratio in self.ratios.values())

    @property
    def greatest(self) -> float:
        return max(ratio.ratio for ratio in self.ratios.values())

    def __str__(self) -> str:
        if len(self.ratios) == 1:
            return interval(next(iter(self.ratios.values())))
        return " to ".join(dict.fromkeys(map(number_text, (self.least, self.greatest))))

    @property
    def verdicts(self) -> str:
        """What was found in each place."""
        verdicts = {"faster": "better", "slower": "worse"}
        return ", ".join(f"{verdicts.get(r.verdict, r.verdict)} on {where}, {interval(r)}" for where, r in self.ratios.items())


def _errors(analysis: Analysis, family: Family) -> Measure:
    return measures.errors_at(analysis, common_spp(*family.members.values()))


def _times(analysis: Analysis, family: Family) -> Measure:
    index = measures.hardest_target(analysis, family)
    if index is None:
        raise ConfigError(f"{', '.join(family.held.values())}: there is no target that all reach with every seed")
    return measures.times_to(analysis, family, index)


def _phrases(where: Where) -> Sequence[str]:
    return [where] if isinstance(where, str) else where


def _only(chosen: Sequence[T], phrase: str, names: Sequence[str], noun: str) -> T:
    """The one that a phrase names. Raises `ConfigError` with the names where there are none or several."""
    if len(chosen) == 1:
        return chosen[0]
    shown = f" ({'; '.join(names[:4])}{'; ...' if len(names) > 4 else ''})" if names else ""
    raise ConfigError(f"{phrase} names {len(names) or 'no'} {noun}s{shown}: one is expected")
