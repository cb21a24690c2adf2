"""The fastest contestant for each scene and target as lines of text, which `raybench run` ends with."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

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
    ratio = best.quality_speedups[index]
    if ratio is not None and best.against is not None and isfinite(ratio.ratio) and ratio.ratio > 0:
        speed = estimate_text((ratio.ratio, ratio.low, ratio.high))
        words += f"; {speed} times as fast as {best.against.name}"
    return words + ("" if len(reached) > 1 else "; no other reached it" if len(verdicts) > 1 else "; it ran alone")


def _interval(verdict: Verdict, index: int) -> tuple[float, float, float]:
    quality = verdict.warm[index]
    return quality.value, quality.low, quality.high
