"""What a sample costs by each rule of light transport. Their images differ, so that speed is no merit."""

from __future__ import annotations

from pathlib import Path

from harness.analysis import Analysis
from harness.report.chapter.document import Paragraph, Section, TablePart
from harness.report.chapter.families import families, identity, pairs, row_of, thousands, usual, value_columns
from harness.report.chapter.sentences import SPEED, plural, tally
from harness.report.tables import Table
from harness.statistics import Estimate
from harness.store.results import Contestant


def section(analysis: Analysis, plots: Path) -> Section | None:
    """What a sample costs by each rule of light transport. Their images differ, so that speed is not a merit."""
    found = families(analysis, "shader")
    if not found:
        return None
    most = max(family.any.settings.threads for family in found)
    shown = usual([family for family in found if family.any.settings.threads == most], "sampler")
    table = Table(
        "shaders", "Cost of a sample by shader",
        f"Nanoseconds a path (a sample of a pixel) with {plural(most, 'thread')}; geometric mean over blocks with a 95 % "
        f"interval. Sampler: {shown[0].held['sampler']}.",
        [*identity(shown),
         *value_columns(shown, "Nanoseconds a path of {}.")],
    )  # fmt: skip
    table.rows += [row_of(family, _nanoseconds) for family in shown]
    said = [tally(pair, SPEED) for pair in pairs(analysis, found)]
    note = "The shaders make different images: this is what a sample costs, not which is better."
    return Section("Shaders", [Paragraph([*said, note]), TablePart(table)])


def _nanoseconds(contestant: Contestant) -> Estimate:
    """Of a path."""
    rate = thousands(contestant)
    return Estimate(1e6 / rate.value, 1e6 / rate.high, 1e6 / rate.low, rate.n)
