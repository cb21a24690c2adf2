"""What came out, in words: a line for each value of each axis, which `raybench run` ends with and the report begins with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from harness.analysis import Analysis
from harness.analysis.axes import SETTINGS
from harness.analysis.baselines import AA, SEVERAL, Baselines
from harness.analysis.model import PER_SAMPLE, Frame, measure_of, ranked_together
from harness.metrics import metric_title
from harness.report.tables.evidence import WITHOUT_TWINS
from harness.report.tables.model import number_text
from harness.statistics.ratios import ALPHA, FEWEST_BLOCKS

MOST_PLACES = 3
"""Places that a line tells one by one; of more it tells the least and the greatest."""
MOST_LINES = 15
"""Lines at the end of a run; the report has all."""
MOST_REPEATS = 200
"""More repeats than these are said to be out of reach."""
DECIDED = ("faster", "slower")
SINGULAR, PLURAL = "'s", "'"
SUBJECTS = ("engine", "accelerator", "shader", "sampler")
"""Axes whose values reach a target; with values of others contestants do."""


class Sentence(NamedTuple):
    """What is known of a value of an axis, against another value; `known` is whether that is a ratio."""

    axis: str
    text: str
    known: bool


def sentences(analysis: Analysis, beside_winners: bool = True) -> list[Sentence]:
    """Every axis in turn, then contestants that differ from all others in several settings; behind these what has no ratio, and
    why. Beside the lines of `winners` the ratios that these give are left out."""
    several = _of_several(analysis)
    if beside_winners:
        several = several[~_told_by_winners(analysis, several)]
    rows = pd.concat([analysis.by_axis, several], ignore_index=True)
    groups: Any = rows.groupby(["axis", "value", "over"], sort=False)
    found = [_sentence(analysis, axis, value, over, own) for (axis, value, over), own in groups]
    told = {each.axis for each in found} | set(several.axis)
    return sorted([*found, *_without_ratio(analysis, told)], key=lambda each: not each.known)


def sentences_text(analysis: Analysis) -> str:
    """The sentences as lines under a heading; empty where nothing was compared."""
    found = sentences(analysis)
    lines = [f"  {each.axis}: {each.text}" for each in found[:MOST_LINES]]
    if len(found) > MOST_LINES:
        lines.append(f"  and {len(found) - MOST_LINES} more, see the report")
    heading = f"What each setting does, all else equal; targets are in {metric_title(analysis.results.metric)}:"
    return "\n".join([heading, *lines, ""]) if found else ""


def _of_several(analysis: Analysis) -> Frame:
    """The rows of `comparisons` of contestants that are compared along no axis, with the columns `LABELS`."""
    found = analysis.comparisons
    along = {(row.scene, name) for row in analysis.by_axis.itertuples() for name in (row.contestant, row.baseline)}
    alone = np.array([who not in along for who in zip(found.scene, found.contestant, strict=True)], bool)
    found = found[alone & (found.baseline != "") & (found.factor != AA)]
    return found.assign(axis=found.factor, value=found.contestant, over=found.baseline, settings="")


def _told_by_winners(analysis: Analysis, rows: Frame) -> np.ndarray:
    """Of rows of contestants: those of races of two that every target has decided, as `winners` says in words, too, on every
    scene."""
    racing = analysis.comparisons[analysis.comparisons.factor != AA].groupby("race").contestant.nunique()
    open_races = set(rows.race[(rows.measure != PER_SAMPLE) & ~rows.verdict.isin(DECIDED)])
    told = pd.Series([racing[race] == 2 and race not in open_races for race in rows.race], rows.index, bool)
    return told.groupby([rows.axis, rows.value, rows.over]).transform("all").to_numpy(bool)


# --- one sentence ---------------------------------------------------------------------------------------------------


class _Words(NamedTuple):
    """The parts of a sentence: `start`, what stands before a share of the time, whose time that is a share of, and what it says
    where the two take as long."""

    start: str
    whose: str
    alike: str


def _words(axis: str, value: str, over: str, target: float | None) -> _Words:
    subject = axis in SUBJECTS or " " in axis
    whose = f"{over}{PLURAL if over.endswith('s') else SINGULAR} time" if subject else f"the time with {over}"
    if target is None:
        start = f"a sample of {value} takes" if subject else f"with {value} a sample takes"
        return _Words(start, whose, f"{start} as long as {'one of' if subject else 'with'} {over}")
    reaches = f"{value} reaches {target:g}" if subject else f"with {value}, {target:g} is reached"
    return _Words(f"{reaches} in", whose, f"{reaches} as soon as {'' if subject else 'with '}{over}")


def _sentence(analysis: Analysis, axis: str, value: str, over: str, rows: Frame) -> Sentence:
    """At the hardest target for which some ratio is known; without one by the seconds of a sample."""
    for target in [*reversed(analysis.results.targets), None]:
        own = rows[rows.measure == (PER_SAMPLE if target is None else measure_of(target))]
        if (own.ratio.gt(0) & own.ratio.lt(math.inf)).any():
            words = _words(axis, value, over, target)
            return Sentence(axis, _of_target(analysis, words, value, over, own, rows), True)
    reasons = dict.fromkeys(why for why in rows.no_ratio if why) or ["neither was measured in a block that both have"]
    return Sentence(axis, f"{value} and {over} are not compared: {'; '.join(reasons)}.", False)


def _of_target(analysis: Analysis, words: _Words, value: str, over: str, rows: Frame, every: Frame) -> str:
    """`rows` are those of one measure, `every` those of all."""
    compared = [row for row in rows.itertuples() if not row.no_ratio]
    told: dict[str, list[Any]] = {}
    for row in compared:
        if 0 < row.ratio < math.inf:
            told.setdefault("decided" if row.verdict in DECIDED else row.verdict, []).append(row)
    known = sorted(told.get("decided", []), key=lambda row: -row.ratio)
    same = 100 * analysis.results.config.same_within
    parts = []
    if known:
        parts.append(f"{words.start} {_shares(known, words.whose)}")
    if alike := told.get("same", []):
        parts.append(f"{'as soon' if known else words.alike} (within {same:g} %) on {_places(alike)}")
    within = told.get("unresolved", [])
    if alone := [row for row in within if _decided_in_its_race(analysis, row)]:
        within = [row for row in within if row not in alone]
        start = "" if parts else f"{words.start} "
        parts.append(f"{start}{_shares(alone, words.whose)} in the race of that scene alone, not in all scenes together")
    if within:
        start = "" if parts else f"{words.start} {_range(within)} {words.whose}: "
        parts.append(f"{start}not separated on {_places(within)}{_repeats(within, _family(analysis, rows), analysis)}")
    parts += _unreached(analysis, compared, value, over, every)
    parts += _not_compared([row for row in rows.itertuples() if row.no_ratio])
    return "; ".join(parts) + "."


def _decided_in_its_race(analysis: Analysis, row: Any) -> bool:
    """Whether the race of the scene finds a ratio faster or slower, which the axis, with more tests, does not."""
    found = analysis.comparisons
    own = (found.scene == row.scene) & (found.contestant == row.contestant) & (found.baseline == row.baseline)
    return bool(found.verdict[own & (found.measure == row.measure)].isin(DECIDED).any())


def _not_compared(rows: Sequence[Any]) -> Iterator[str]:
    """Where there is no ratio, by reason; what differs behind a colon is left to the table."""
    by_reason: dict[str, list[Any]] = {}
    for row in rows:
        by_reason.setdefault(row.no_ratio.partition(":")[0], []).append(row)
    for short, own in by_reason.items():
        reasons = {row.no_ratio for row in own}
        yield f"no ratio on {_places(own)} ({reasons.pop() if len(reasons) == 1 else short})"


def _shares(rows: Sequence[Any], whose: str) -> str:
    """`0.38 (0.36 to 0.41) of random's time on cornell_box, 0.5 (0.4 to 0.6) on gears`."""
    of = _of_or_times(1 / rows[0].ratio)
    if len(rows) > MOST_PLACES:
        least, most = ((_share(row), _place(row)) for row in (rows[0], rows[-1]))
        return f"{least[0]} {of} {whose} on {least[1]} to {most[0]} on {most[1]}, {len(rows)} comparisons in all"
    first, *rest = [(f"{_share(row)} ({_interval(row)})", _place(row)) for row in rows]
    return ", ".join([f"{first[0]} {of} {whose} on {first[1]}", *(f"{share} on {place}" for share, place in rest)])


def _of_or_times(share: float) -> str:
    """`0.4 of the time`, `1.8 times the time`."""
    return "of" if share <= 1 else "times"


def _share(row: Any) -> str:
    return number_text(1 / row.ratio)


def _interval(row: Any) -> str:
    low = 0.0 if math.isinf(row.ratio_high) else 1 / row.ratio_high
    return f"{number_text(low)} to {number_text(1 / row.ratio_low) if row.ratio_low > 0 else 'any'}"


def _range(rows: Sequence[Any]) -> str:
    """The interval of one row, of several rows from the lowest end to the highest: `0.9 to 1.2 times`."""
    lows = [0.0 if math.isinf(row.ratio_high) else 1 / row.ratio_high for row in rows]
    highs = [1 / row.ratio_low if row.ratio_low > 0 else math.inf for row in rows]
    if any(map(math.isnan, [*lows, *highs])):
        return f"{_share(rows[0])} {_of_or_times(1 / rows[0].ratio)}"
    return f"{number_text(min(lows))} to {number_text(max(highs))} {_of_or_times(max(highs))}"


def _place(row: Any) -> str:
    return f"{row.scene} ({row.settings})" if row.settings else row.scene


def _places(rows: Sequence[Any]) -> str:
    names = [_place(row) for row in rows]
    if len(names) > MOST_PLACES:
        return f"{len(names)} ({', '.join(names[:MOST_PLACES])}, ...)"
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _unreached(analysis: Analysis, rows: Sequence[Any], value: str, over: str, every: Frame) -> Iterator[str]:
    """Who did not get there, of ratios that are bounds or unknown: a time of which only a bound is known, such as that of a
    first checkpoint, makes such a ratio, too."""
    reached = {(row.scene, row.contestant, row.measure): row.reached == row.seeds for row in analysis.by_target.itertuples()}
    cases: dict[str, list[Any]] = {}
    for row in rows:
        if 0 < row.ratio < math.inf:
            continue
        own, base = (reached.get((row.scene, name, row.measure), True) for name in (row.contestant, row.baseline))
        if row.blocks == 0:
            words = "no block has both"
        elif not own or not base:
            who = "neither reached" if own == base else f"{over if own else value} did not reach"
            words = f"{who} it"
        else:
            words = f"only a bound of the ratio is known ({row.verdict})"
        cases.setdefault(words, []).append(row)
    for words, places in cases.items():
        easier = [text for row in places[:MOST_PLACES] if (text := _at_easier_target(analysis, row, every))]
        yield f"{words} on {_places(places)}" + (f" ({', '.join(easier)})" if easier else "")


def _at_easier_target(analysis: Analysis, row: Any, every: Frame) -> str:
    """The ratio of a row's contestants at the hardest target that has one: `0.01 in 0.4 (0.3 to 0.5) on gears`, or empty."""
    same = every[(every.scene == row.scene) & (every.settings == row.settings) & (every.no_ratio == "")]
    for target in reversed(analysis.results.targets):
        for found in same[same.measure == measure_of(target)].itertuples():
            if 0 < found.ratio < math.inf and not math.isnan(found.ratio_low):
                unless = "" if found.verdict in (*DECIDED, "same") else ", not separated,"
                return f"{target:g} in {_share(found)} ({_interval(found)}){unless} on {_place(row)}"
    return ""


# --- how many repeats ----------------------------------------------------------------------------------------------


def _family(analysis: Analysis, rows: Frame) -> int:
    """How many ratios hold together with these: those of their axis, or race, in their measure."""
    first = rows.iloc[0]
    found = analysis.by_axis if first.axis in set(analysis.by_axis.axis) else analysis.comparisons
    together = (found.race == first.race) & (found.measure == first.measure) & (found.no_ratio == "")
    return max(1, int(together.sum()))


def repeats_to_separate(row: Any, family: int, same_within: float) -> float:
    """About how many repeats a ratio takes to be faster or slower in a family of so many, or the same, if its mean and spread
    stay as they are: of the interval all but the persistent spread shrinks with the root of their number; infinite where that
    alone is too wide. NaN without an interval, and where that is narrow enough already: then something else than too few
    repeats stands in the way."""
    if not 0 < row.ratio_low < row.ratio_high < math.inf:
        return math.nan
    half = math.log(row.ratio_high / row.ratio_low) / 2
    distance, margin = abs(math.log(row.ratio)), math.log1p(same_within)
    wider, narrower = (float(ndtri(1 - level / 2) / ndtri(1 - ALPHA / 2)) for level in (ALPHA / max(1, family), 2 * ALPHA))
    needed = max(distance / wider, (margin - distance) / narrower)
    if needed >= half:
        return math.nan
    persistent = 0.0 if math.isnan(row.persistent_spread) else math.log1p(row.persistent_spread) * float(ndtri(1 - ALPHA / 2))
    if needed <= persistent:
        return math.inf
    return math.ceil(row.blocks * max(1.0, (half**2 - persistent**2) / (needed**2 - persistent**2)))


NOISY_REFERENCE = "the reference is too noisy: it needs more time, reference.max_time, or samples, reference.spp"


def _repeats(rows: Sequence[Any], family: int, analysis: Analysis) -> str:
    """` (some 12 repeats would separate them)`."""
    if max(row.blocks for row in rows) < FEWEST_BLOCKS:
        return f" (fewer than {FEWEST_BLOCKS} repeats: no verdict is given)"
    if not any(analysis.spreads[row.scene, row.contestant].twins for row in rows):
        return f" ({WITHOUT_TWINS})"
    judged = [row for row in rows if row.blocks >= FEWEST_BLOCKS]
    clear = {(row.scene, row.contestant, row.measure): row.reliable for row in analysis.by_target.itertuples()}
    if not all(clear.get((row.scene, name, row.measure), True) for row in judged for name in (row.contestant, row.baseline)):
        return f" ({NOISY_REFERENCE})"
    found = [repeats_to_separate(row, family, analysis.results.config.same_within) for row in judged]
    known = sorted(number for number in found if not math.isnan(number))
    if not known:
        return ""
    if known[0] > MOST_REPEATS:
        return f" (more than {MOST_REPEATS} repeats would be needed)"
    ends = [f"{number:.0f}" if number <= MOST_REPEATS else f"more than {MOST_REPEATS}" for number in (known[0], known[-1])]
    return f" (some {' to '.join(dict.fromkeys(ends))} repeats would tell)"


# --- axes without a ratio ------------------------------------------------------------------------------------------


def _without_ratio(analysis: Analysis, told: set[str]) -> Iterator[Sentence]:
    """Of settings that vary without a ratio: in what else contestants differ, and that images have several sizes."""
    baselines = Baselines(analysis.results)
    nearest: dict[str, list[str]] = {}
    for group in ranked_together(analysis.verdicts).values():
        racing = [verdict.contestant for verdict in group]
        for place, one in enumerate(racing):
            for other in racing[:place]:
                between = baselines.factors(one, other)
                for axis in between:
                    if axis in SETTINGS and axis not in told:
                        nearest[axis] = min(nearest.get(axis, between), between, key=len)
    for axis, between in nearest.items():
        also = SEVERAL.join(name for name in between if name != axis)
        yield Sentence(axis, f"no ratio of {axis} alone: contestants that differ in it differ in {also} too.", False)
    settings = [contestant.settings for contestant in analysis.results.contestants]
    sizes = {(each.scene, each.width, each.height) for each in settings}
    if len(sizes) > len({each.scene for each in settings}):
        yield Sentence("resolution", "images of different sizes have no ratio: each size is a race of its own.", False)
