"""Who is the fastest for each scene and target, in words, which `raybench run` ends with and the report begins with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, NamedTuple

from harness.analysis import Analysis
from harness.analysis.columns import estimate_of
from harness.analysis.model import Verdict
from harness.metrics import metric_title
from harness.report.plots.panels import Panel, panels
from harness.report.tables.model import estimate_text, some

MOST_NAMES = 4


@dataclass(frozen=True)
class Standing:
    """Who may be the fastest of a panel to a target, by mean times: one of `possible` is the fastest, several are not
    separated, and where there is none `nobody` says why. `rows`: of `Analysis.by_target`, one a verdict."""

    panel: Panel
    rows: list[Any]

    @property
    def possible(self) -> list[tuple[Verdict, Any]]:
        found = [(verdict, row) for verdict, row in zip(self.panel.verdicts, self.rows, strict=True) if row.possible_winner]
        return sorted(found, key=lambda pair: pair[1].seconds)

    @property
    def reached(self) -> list[Any]:
        return [row for row in self.rows if row.reached]

    @property
    def ranked(self) -> list[Any]:
        return [row for row in self.rows if row.ranked]

    @property
    def nobody(self) -> str:
        """Why none may be the fastest; empty where one may."""
        if self.possible:
            return ""
        if not self.reached:
            return "not reached"
        ranked = any(row.ranked for row in self.reached)
        return "the reference is too noisy to rank those that reached it" if ranked else "none that reached it is ranked"

    @property
    def disqualified(self) -> list[Verdict]:
        return [verdict for verdict in self.panel.verdicts if verdict.disqualified]

    @property
    def left_out(self) -> list[str]:
        """Those that a flag disqualifies, each with the reason."""
        return [f"{verdict.contestant.name} ({verdict.why_not_ranked})" for verdict in self.disqualified]

    @property
    def noisy(self) -> int:
        """How many are ranked by times that the reference's noise may have moved."""
        return sum(not row.reliable for row in self.ranked)

    def ratio_of(self, row: Any) -> tuple[str, str]:
        """The paired ratio to its baseline. Where it is itself the baseline of others, the inverse of the fastest of them."""
        if isfinite(row.ratio) and row.ratio > 0:
            return estimate_text(estimate_of(row, "ratio")), row.baseline
        rivals = [
            each
            for each in self.ranked
            if each.baseline == row.contestant and 0 < each.ratio_low <= each.ratio <= each.ratio_high < inf
        ]
        if not rivals:
            return "", ""
        rival = min(rivals, key=lambda each: each.seconds)
        return estimate_text((1 / rival.ratio, 1 / rival.ratio_high, 1 / rival.ratio_low)), rival.contestant

    def doubt(self, row: Any, other: str) -> str:
        """A remark where the ratio of two is neither faster nor slower by itself: other tests say who is first."""
        verdict = next(
            each.verdict for each in (row, *self.ranked) if {each.contestant, each.baseline} == {row.contestant, other}
        )
        return {"same": " (the same within the margin)", "unresolved": " (not separated by this ratio alone)"}.get(verdict, "")


def standing(analysis: Analysis, panel: Panel, target: float) -> Standing:
    """Who is the fastest of a panel to a target."""
    return Standing(panel, [analysis.at(verdict.contestant, target) for verdict in panel.verdicts])


class Winner(NamedTuple):
    """What is known of a scene and target. `first` is the contestant that is the fastest, empty where none is alone so, and
    `rivals` how many others are ranked."""

    scene: str
    target: float
    first: str
    rivals: int
    text: str


def winners(analysis: Analysis) -> list[Winner]:
    """One a panel and target."""
    return [
        _winner(panel, target, standing(analysis, panel, target))
        for panel in panels(analysis)
        for target in analysis.results.targets
    ]


def winners_text(analysis: Analysis) -> str:
    """A heading and a line for each panel and target; empty where nothing was compared."""
    found = [f"  {each.scene} to {each.target:g}: {each.text}" for each in winners(analysis)]
    heading = f"Fastest to each target in {metric_title(analysis.results.metric)}, in seconds of rendering:"
    return "\n".join([heading, *found, ""]) if found else ""


def tally(found: Sequence[Winner]) -> str:
    """Who is first how often, of those that race with others."""
    raced = [each.first for each in found if each.rivals > 0]
    counts = Counter(filter(None, raced))
    told = [f"{name} is first in {count}" for name, count in counts.most_common()]
    unclear = len(raced) - counts.total()
    parts = [some(told, MOST_NAMES), f"in {unclear} no contestant alone is first" if unclear else ""]
    return f"Of {len(raced)} races to a target {'; '.join(filter(None, parts))}." if raced else ""


def _winner(panel: Panel, target: float, of: Standing) -> Winner:
    first = of.possible[0][1].contestant if len(of.possible) == 1 else ""
    return Winner(panel.title, target, first, len(of.ranked) - 1, "; ".join(_parts(of)))


def _parts(of: Standing) -> Iterator[str]:
    if len(of.possible) == 1:
        ((verdict, best),) = of.possible
        _, bracket, interval = seconds_text(best).partition(" [")
        if len(of.ranked) > 1:
            said = "is first, after"
        else:
            said = "is the only one ranked and took" if len(of.rows) > 1 else "ran alone and took"
        yield f"{best.contestant} {said} {_value(best)}{bracket}{interval}"
        ratio, other = of.ratio_of(best)
        others = [row for row in of.ranked if isfinite(row.seconds) and row is not best]
        if others and (second := min(others, key=lambda row: row.seconds)).contestant != other:
            yield f"the next is {second.contestant}, after {_value(second)}"
        if ratio:
            yield f"{other} takes {ratio} times as long{of.doubt(best, other)}"
        if verdict.warnings:
            yield f"beware: {', '.join(verdict.warnings)}"
    elif of.possible:
        names = [f"{row.contestant} ({_value(row)})" for _, row in of.possible]
        yield f"not separated ({len(names)}): {some(names, MOST_NAMES)}"
    else:
        yield of.nobody
    reached, out_of = len(of.reached), len(of.rows)
    if reached == 1 == len(of.possible) < out_of:
        yield "no other reached it"
    elif 0 < reached < out_of:
        yield f"{reached} of {out_of} contestants reached it in at least one repeat"
    if of.noisy and of.possible:
        yield f"the reference is too noisy for {of.noisy} of them, whose times are bounds"
    if of.reached and of.disqualified:
        names = [verdict.contestant.name for verdict in of.disqualified]
        yield f"flagged, so not ranked: {of.left_out[0] if len(names) == 1 else some(names, MOST_NAMES)}"


def _value(row: Any) -> str:
    """Seconds without their interval."""
    text = seconds_text(row).partition(" [")[0]
    return f"{text} s" if text[-1:].isdigit() else text


def seconds_text(row: Any) -> str:
    """Seconds of rendering until a target, with their interval."""
    return estimate_text(estimate_of(row, "seconds"))
