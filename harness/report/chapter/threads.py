"""How much more threads give."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.analysis import Analysis
from harness.report.chapter import figures
from harness.report.chapter.document import Paragraph, Section, TablePart
from harness.report.chapter.families import Family, Found, compare, demanding, families, identity, values
from harness.report.chapter.sentences import listed, plural
from harness.report.tables import Column, Table
from harness.report.tables.model import number_text
from harness.statistics import Estimate


def section(analysis: Analysis, plots: Path) -> Section | None:
    """How much more threads give."""
    found = families(analysis, "threads")
    if not found:
        return None
    names = sorted(values(found), key=lambda value: int(value.split()[0]))
    sentences = [_gain(analysis, found, names[0], name) for name in names[1:]]
    shown = demanding(found, ("scene", "accelerator"))
    shaders = listed(list(dict.fromkeys(family.shader for family in shown)))
    table = Table(
        "threads", f"Speed-up over {names[0]}",
        f"Paired by block, with 95 % intervals; efficiency 1 is ideal. Shader: {shaders}.",
        [*identity(shown),
         *(Column(name, f"Speed-up of {name}.", "estimate", name) for name in names[1:]),
         Column("efficiency", f"Speed-up of {names[-1]} over the share of threads.", "number")],
    )  # fmt: skip
    for family in shown:
        table.rows.append(_thread_row(analysis, family, names))
    drawn = figures.thread_gains(analysis, found, names, plots)
    return Section("Threads", [Paragraph(sentences), *figures.part(drawn), TablePart(table)])


def _thread_row(analysis: Analysis, family: Family, names: list[str]) -> dict[str, Any]:
    row: dict[str, Any] = dict(family.held)
    for name in names[1:]:
        if {names[0], name} <= set(family.members):
            gain = compare(analysis, family, name, names[0])
            row[name] = Estimate(*gain[:4])
            row["efficiency"] = gain.ratio * int(names[0].split()[0]) / int(name.split()[0])
    return row


def _gain(analysis: Analysis, found: list[Family], base: str, name: str) -> str:
    """What more threads give over all configurations, and where they give nothing."""
    gains = [
        Found(family, compare(analysis, family, name, base))
        for family in found if base in family.members and name in family.members
    ]  # fmt: skip
    faster = [gain for gain in gains if gain.speedup.verdict == "faster"]
    ratios = sorted(gain.speedup.ratio for gain in gains)
    text = f"With {name} rendering is faster than with {base} in {len(faster)} of {plural(len(gains), 'configuration')}"
    if ratios:
        middle = (ratios[(len(ratios) - 1) // 2] + ratios[len(ratios) // 2]) / 2
        text += f"; the median speed-up is {number_text(middle)}"
        if len(ratios) > 1:
            text += f", the least {number_text(ratios[0])} and the greatest {number_text(ratios[-1])}"
    return text + "."
