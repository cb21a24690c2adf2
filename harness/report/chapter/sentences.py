"""Sentences made from findings: who is better, by how much, how sure that is, and what is not separated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from harness.report.chapter.families import Found, Pair, reciprocal, spread
from harness.report.plots.curves import error_label
from harness.report.tables.model import number_text
from harness.statistics import Estimate, Ratio
from harness.statistics.ratios import FEWEST_BLOCKS


class Wording(NamedTuple):
    """How a measure is spoken of: `better` joins the better one to the other, `ratio` names what is compared."""

    better: str
    ratio: str


SPEED = Wording("is faster than", "the ratio of their speeds")
ERROR = Wording("has a smaller error than", "the ratio of their errors")
QUALITY = Wording("reaches it before", "the ratio of their times")


def interval(estimate: Estimate | Ratio) -> str:
    """`2.1 (1.9 to 2.3)`: a value with its interval, or alone where there is none."""
    value, low, high = estimate[:3]
    text = "unbounded" if math.isinf(value) else number_text(value)
    if math.isnan(low) or math.isnan(high) or low == high:
        return text
    return f"{text} ({number_text(low)} to {'any' if math.isinf(high) else number_text(high)})"


def finding(one: str, other: str, ratio: Ratio, wording: Wording = SPEED) -> str:
    """What was found of two, as a clause without full stop; the better one is the subject."""
    if ratio.verdict == "slower":
        return finding(other, one, reciprocal(ratio), wording)
    if ratio.verdict == "faster":
        return f"{one} {wording.better} {other} by a factor of {interval(ratio)}"
    if ratio.verdict == "same":
        return f"{one} and {other} are the same within the margin: {wording.ratio} is {interval(ratio)}"
    if ratio.blocks >= FEWEST_BLOCKS:
        return f"{one} and {other} are not separated: {wording.ratio} is {interval(ratio)}"
    return f"{one} and {other} were not measured often enough to be compared"


def tally(pair: Pair, wording: Wording = SPEED, case: str = "case") -> str:
    """What all families say of a pair, in one sentence: how often one is better, by what factors, and what is left open."""
    first, second, found = pair
    often = [one for one in found if one.speedup.blocks >= FEWEST_BLOCKS]
    better, worse, same = (pair.of(verdict) for verdict in ("faster", "slower", "same"))
    known = len(often)
    undecided = known - len(better) - len(worse) - len(same)
    if not known:
        return f"{first} and {second} were not measured often enough to be compared."
    cases = f"{known} {case}s"
    if len(same) == known:
        text = f"{first} and {second} are the same within the margin{'' if known == 1 else f' in all {cases}'}"
    elif not better and not worse:
        text = f"{first} and {second} are not separated{'' if known == 1 else f' in any of {cases}'}"
    elif len(better) == len(worse):
        text = f"Of {cases}, {first} {wording.better} {second} in {_with_factor(better)}, "
        text += f"and the other way round in {_with_factor(reciprocals(worse))}"
    else:
        where = f" in {_share(len(better), cases, known)}," if known > 1 else ""
        text = f"{first} {wording.better} {second}{where} by {_factors(better)}"
        if worse:
            text += f"; the other way round in {_with_factor(reciprocals(worse))}"
    if same and len(same) < known:
        text += f"; in {len(same)} they are the same"
    if undecided and better + worse + same:
        text += f"; {undecided} {'is' if undecided == 1 else 'are'} unresolved"
    if known < len(found):
        text += f"; {len(found) - known} more were not measured often enough to say"
    return f"{text}."


def reciprocals(found: Sequence[Found]) -> list[Found]:
    return [Found(one.family, reciprocal(one.speedup)) for one in found]


def _share(number: int, cases: str, known: int) -> str:
    return f"{number} of {cases}" if number < known else f"all {cases}"


def _factors(found: Sequence[Found]) -> str:
    text = spread(found)
    return f"factors of {text}" if " to " in text else f"a factor of {text}"


def _with_factor(found: Sequence[Found]) -> str:
    return f"{len(found)} (by {_factors(found)})"


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return "".join(names) if len(names) < 2 else f"{', '.join(names[:-1])} and {names[-1]}"


def error_name(metric: str) -> str:
    """A metric as an error: `relMSE (ε = 0.01)`."""
    return error_label(metric).replace("−", "-")


def plural(number: int, noun: str) -> str:
    """`1 scene`, `7 scenes`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
