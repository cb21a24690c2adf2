"""The fastest contestant for each scene and target as lines of text, which `raybench run` ends with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isfinite

from harness.analysis import Analysis
from harness.analysis.model import Verdict, possible_winners
from harness.metrics import metric_title
from harness.report.plots.panels import panels
from harness.report.tables.model import estimate_text

MOST_NAMES = 4


def winners_text(analysis: Analysis) -> str:
    """A heading and a line for each panel and target; empty where nothing was compared."""
    found = [f"  {line}" for line in _lines(analysis)]
    heading = f"Fastest to each target in {metric_title(analysis.results.metric)}, in seconds of rendering:"
    return "\n".join([heading, *found, ""]) if found else ""


def _lines(analysis: Analysis) -> Iterator[str]:
    for panel in panels(analysis):
        for index, target in enumerate(analysis.results.targets):
            yield f"{panel.title} to {target:g}: {_line(panel.verdicts, index)}"


def _line(verdicts: list[Verdict], index: int) -> str:
    reached = [verdict for verdict in verdicts if verdict.warm[index].reached]
    unranked = sum(bool(verdict.disqualified) for verdict in reached)
    return _fastest(verdicts, index, reached) + (f"; {unranked} flagged, so not ranked" if unranked else "")


def _fastest(verdicts: list[Verdict], index: int, reached: list[Verdict]) -> str:
    found = possible_winners(verdicts, index)
    if not found:
        return "none of those that reached it is ranked" if reached else "not reached"
    if len(found) > 1:
        names = [verdict.contestant.name for verdict in found]
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        return f"not separated ({len(names)}): {', '.join(names[:MOST_NAMES])}{more}"
    best = found[0]
    words = f"{best.contestant.name}, {estimate_text(_interval(best, index))}"
    ratio, other = ratio_of(best, verdicts, index)
    if ratio:
        words += f"; {ratio} times as fast as {other}"
    return words + ("" if len(reached) > 1 else "; no other reached it" if len(verdicts) > 1 else "; it ran alone")


def ratio_of(verdict: Verdict, verdicts: Sequence[Verdict], index: int) -> tuple[str, str]:
    """The paired ratio to its baseline. Where it is itself the baseline of others, the inverse of the fastest of them."""
    own = verdict.quality_speedups[index]
    if own is not None and verdict.against is not None and isfinite(own.ratio) and own.ratio > 0:
        return estimate_text((own.ratio, own.low, own.high)), verdict.against.name
    rivals = [
        (each, ratio)
        for each in verdicts
        if each.against is verdict.contestant
        and not each.disqualified
        and (ratio := each.quality_speedups[index]) is not None
        and 0 < ratio.low <= ratio.ratio <= ratio.high < inf
    ]
    if not rivals:
        return "", ""
    rival, ratio = min(rivals, key=lambda pair: pair[0].warm[index].value)
    return estimate_text((1 / ratio.ratio, 1 / ratio.high, 1 / ratio.low)), rival.contestant.name


def _interval(verdict: Verdict, index: int) -> tuple[float, float, float]:
    quality = verdict.warm[index]
    return quality.value, quality.low, quality.high
