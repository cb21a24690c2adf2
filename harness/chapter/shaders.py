"""What a sample costs by each rule of light transport. Their images differ, so that speed is no merit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.analysis import Analysis
from harness.chapter.document import Paragraph, Section, TablePart
from harness.chapter.families import families, identity, pairs, thousands, usual, values
from harness.chapter.sentences import SPEED, plural, tally
from harness.statistics import Estimate
from harness.tables import Column, Table


def section(analysis: Analysis, plots: Path) -> Section | None:
    """What a sample costs by each rule of light transport. Their images differ, so that speed is not a merit."""
    found = families(analysis, "shader")
    if not found:
        return None
    most = max(family.any.settings.threads for family in found)
    shown = usual([family for family in found if family.any.settings.threads == most], "sampler")
    names = values(found)
    table = Table(
        "shaders", "Cost of a sample by shader",
        f"Nanoseconds a path (a sample of a pixel) with {plural(most, 'thread')}; median over blocks with a 95 % "
        f"interval. Sampler: {shown[0].held['sampler']}.",
        [*identity(shown),
         *(Column(name, f"Nanoseconds a path of {name}.", "estimate", name) for name in names)],
    )  # fmt: skip
    for family in shown:
        row: dict[str, Any] = dict(family.held)
        for value, contender in family.members.items():
            rate = thousands(contender)
            row[value] = Estimate(1e6 / rate.value, 1e6 / rate.high, 1e6 / rate.low, rate.n)
        table.rows.append(row)
    said = [tally(pair, SPEED) for pair in pairs(analysis, found)]
    note = "The shaders make different images: this is what a sample costs, not which is better."
    return Section("Shaders", [Paragraph([*said, note]), TablePart(table)])
