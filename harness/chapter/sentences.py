"""Sentences made from measured numbers: who is faster, by how much, how sure that is, and what is a tie."""

from __future__ import annotations

import math
from collections.abc import Sequence

from harness.statistics import Estimate, Speedup
from harness.tables.model import number_text


def interval(estimate: Estimate | Speedup, unit: str = "") -> str:
    """`2.1 (1.9 to 2.3)` with its 95 % interval, or the value alone where there is none."""
    value, low, high = estimate[:3]
    text = f"{number_text(value)}{unit}"
    if math.isnan(low) or math.isnan(high) or low == high:
        return text
    bound = "without bound" if math.isinf(high) else number_text(high)
    return f"{text} ({number_text(low)} to {bound})"


def compared(other: str, baseline: str, speedup: Speedup, what: str = "") -> str:
    """What `paired_speedup(baseline, other)` found, as a clause without full stop; the faster one is the subject."""
    tail = f" {what}" if what else ""
    if speedup.verdict == "faster":
        return f"{other} is {_times(speedup)} as fast as {baseline}{tail}"
    if speedup.verdict == "slower":
        return f"{baseline} is {_times(reciprocal(speedup))} as fast as {other}{tail}"
    if speedup.verdict == "tie":
        return f"{other} and {baseline} cannot be told apart{tail}: the ratio of their speeds is {interval(speedup)}"
    return f"{other} and {baseline} were not measured often enough to be compared{tail}"


def reciprocal(speedup: Speedup) -> Speedup:
    """The same finding seen from the other side."""
    turned = {"faster": "slower", "slower": "faster"}.get(speedup.verdict, speedup.verdict)
    return Speedup(_inverse(speedup.ratio), _inverse(speedup.high), _inverse(speedup.low), speedup.pairs, turned)


def _inverse(value: float) -> float:
    return math.inf if value == 0 else 1 / value


def _times(speedup: Speedup) -> str:
    if math.isinf(speedup.ratio):
        return "beyond measure"
    return f"{interval(speedup)} times"


def words(names: Sequence[str], last: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def count(number: int, singular: str, plural: str = "") -> str:
    """`one scene`, `three scenes`, `27 scenes`."""
    word = _NUMBERS[number] if number < len(_NUMBERS) else str(number)
    return f"{word} {singular if number == 1 else plural or singular + 's'}"


def sentence(clause: str) -> str:
    """A clause with a capital and a full stop; names of engines keep their small letter inside."""
    return f"{clause[:1].upper()}{clause[1:]}."
