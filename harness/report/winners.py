"""Who is the fastest for each scene and target, and that as lines of text, which `raybench run` ends with."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from harness.analysis import Analysis
from harness.analysis.columns import estimate_of
from harness.analysis.model import Verdict
from harness.metrics import metric_title
from harness.report.plots.panels import Panel, panels
from harness.report.tables.model import estimate_text

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
    def left_out(self) -> list[str]:
        """Those that a flag disqualifies, each with its flags in words."""
        flagged = [verdict for verdict in self.panel.verdicts if verdict.disqualified]
        return [f"{verdict.contestant.name} ({', '.join(verdict.warnings)})" for verdict in flagged]

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


def standing(analysis: Analysis, panel: Panel, target: float) -> Standing:
    """Who is the fastest of a panel to a target."""
    return Standing(panel, [analysis.at(verdict.contestant, target) for verdict in panel.verdicts])


def winners_text(analysis: Analysis) -> str:
    """A heading and a line for each panel and target; empty where nothing was compared."""
    found = [
        f"  {panel.title} to {target:g}: {_line(standing(analysis, panel, target))}"
        for panel in panels(analysis)
        for target in analysis.results.targets
    ]
    heading = f"Fastest to each target in {metric_title(analysis.results.metric)}, in seconds of rendering:"
    return "\n".join([heading, *found, ""]) if found else ""


def _line(of: Standing) -> str:
    unranked = sum(not row.ranked for row in of.reached)
    return _fastest(of) + (f"; {unranked} flagged, so not ranked" if unranked else "")


def _fastest(of: Standing) -> str:
    if not of.possible:
        return of.nobody
    if len(of.possible) > 1:
        names = [row.contestant for _, row in of.possible]
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        return f"not separated ({len(names)}): {', '.join(names[:MOST_NAMES])}{more}"
    ((_, best),) = of.possible
    words = f"{best.contestant}, {seconds_text(best)}"
    ratio, other = of.ratio_of(best)
    if ratio:
        words += f"; {ratio} times as fast as {other}"
    alone = "no other reached it" if len(of.rows) > 1 else "it ran alone"
    return words + ("" if len(of.reached) > 1 else f"; {alone}")


def seconds_text(row: Any) -> str:
    """Seconds of rendering until a target, with their interval."""
    return estimate_text(estimate_of(row, "seconds"))
