"""Who is the fastest for each scene and target, and that as lines of text, which `raybench run` ends with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

from harness.analysis import Analysis
from harness.analysis.model import NOISY, Verdict, possible_winners
from harness.metrics import metric_title
from harness.report.plots.panels import Panel, panels
from harness.report.tables.model import estimate_text
from harness.statistics import QualityTime

MOST_NAMES = 4


@dataclass(frozen=True)
class Standing:
    """Who may be the fastest of a panel to the target of `index`, by mean times: one of `possible` is the fastest, several are
    not separated, and where there is none, none that reached it is ranked."""

    panel: Panel
    index: int
    possible: list[Verdict]

    @property
    def reached(self) -> list[Verdict]:
        return [verdict for verdict in self.panel.verdicts if verdict.warm[self.index].reached]

    @property
    def ranked(self) -> list[Verdict]:
        return [verdict for verdict in self.panel.verdicts if not verdict.disqualified]

    @property
    def left_out(self) -> list[str]:
        """Those that a flag disqualifies, each with its flags in words."""
        flagged = [verdict for verdict in self.panel.verdicts if verdict.disqualified]
        return [f"{verdict.contestant.name} ({', '.join(verdict.warnings)})" for verdict in flagged]

    @property
    def noisy(self) -> int:
        """How many are ranked by times that the reference's noise may have moved."""
        return sum(NOISY in verdict.flags_of(self.index) for verdict in self.ranked)


def standing(panel: Panel, index: int) -> Standing:
    """Who is the fastest of a panel to the target of `index`."""
    return Standing(panel, index, possible_winners(panel.verdicts, index))


def winners_text(analysis: Analysis) -> str:
    """A heading and a line for each panel and target; empty where nothing was compared."""
    targets = list(enumerate(analysis.results.targets))
    found = [
        f"  {panel.title} to {target:g}: {_line(standing(panel, i))}" for panel in panels(analysis) for i, target in targets
    ]
    heading = f"Fastest to each target in {metric_title(analysis.results.metric)}, in seconds of rendering:"
    return "\n".join([heading, *found, ""]) if found else ""


def _line(of: Standing) -> str:
    unranked = sum(verdict.disqualified for verdict in of.reached)
    return _fastest(of) + (f"; {unranked} flagged, so not ranked" if unranked else "")


def _fastest(of: Standing) -> str:
    if not of.possible:
        return "none of those that reached it is ranked" if of.reached else "not reached"
    if len(of.possible) > 1:
        names = [verdict.contestant.name for verdict in of.possible]
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        return f"not separated ({len(names)}): {', '.join(names[:MOST_NAMES])}{more}"
    (best,) = of.possible
    words = f"{best.contestant.name}, {seconds_text(best.warm[of.index])}"
    ratio, other = ratio_of(best, of.panel.verdicts, of.index)
    if ratio:
        words += f"; {ratio} times as fast as {other}"
    alone = "no other reached it" if len(of.panel.verdicts) > 1 else "it ran alone"
    return words + ("" if len(of.reached) > 1 else f"; {alone}")


def seconds_text(quality: QualityTime) -> str:
    """Seconds to a target with their interval."""
    return estimate_text((quality.value, quality.low, quality.high))


def ratio_of(verdict: Verdict, verdicts: Sequence[Verdict], index: int) -> tuple[str, str]:
    """The paired ratio to its baseline. Where it is itself the baseline of others, the inverse of the fastest of them."""
    own = verdict.quality_speedups[index]
    if own is not None and verdict.baseline is not None and isfinite(own.ratio) and own.ratio > 0:
        return estimate_text((own.ratio, own.low, own.high)), verdict.baseline.name
    rivals = [
        (each, ratio)
        for each in verdicts
        if each.baseline is verdict.contestant
        and not each.disqualified
        and (ratio := each.quality_speedups[index]) is not None
        and 0 < ratio.low <= ratio.ratio <= ratio.high < inf
    ]
    if not rivals:
        return "", ""
    rival, ratio = min(rivals, key=lambda pair: pair[0].warm[index].value)
    return estimate_text((1 / ratio.ratio, 1 / ratio.high, 1 / ratio.low)), rival.contestant.name
