"""Which accelerator finds hits fastest, and on which scene."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

from harness.analysis import Analysis
from harness.report.chapter import figures
from harness.report.chapter.document import Listing, Paragraph, Section, TablePart
from harness.report.chapter.families import (
    HEADINGS,
    Family,
    best,
    compare,
    demanding,
    estimate,
    families,
    identity,
    pairs,
    ranking,
    row_of,
    thousands,
    value_columns,
)
from harness.report.chapter.sentences import SPEED, finding, listed, plural, tally
from harness.report.tables import Column, Table
from harness.statistics import Estimate
from harness.store.results import Contestant


def section(analysis: Analysis, plots: Path) -> Section | None:
    """Which finds hits fastest, on which scene."""
    every = families(analysis, "accelerator")
    if not every:
        return None
    most = max(family.any.settings.threads for family in every)
    found = [family for family in every if family.any.settings.threads == most]
    shown = _speed_table(
        "accelerators", "Samples a second by accelerator",
        f"Thousands of paths (samples of a pixel) a second with {plural(most, 'thread')}; geometric mean over blocks with a "
        "95 % interval. Fastest: all that may be it.",
        analysis, found,
    )  # fmt: skip
    parts = [
        Paragraph([tally(pair, SPEED) for pair in pairs(analysis, every)]),
        Listing([_order(analysis, family) for family in demanding(found)]),
        TablePart(shown),
    ]
    drawn = figures.speeds(demanding(found), plots)
    return Section("Accelerators", [*parts, *figures.part(drawn), TablePart(_build_table(found))])


def _order(analysis: Analysis, family: Family) -> str:
    """Who is fastest on a scene, and each by how much before the next."""
    order = ranking(family)
    primitives = int(family.any.cells[0].get("primitives") or 0)
    steps = [
        finding(one, other, compare(analysis, family, one, other))
        for one, other in pairwise(order)
    ]
    size = f" ({plural(primitives, 'primitive')})" if primitives else ""
    return f"{family.scene}{size}, {family.shader}: {'; '.join(steps)}."


def _speed_table(name: str, title: str, note: str, analysis: Analysis, found: list[Family]) -> Table:
    table = Table(name, title, note, [
        *identity(found), *value_columns(found, "Thousands of paths a second of {}."),
        Column("fastest", "The fastest, or all that may be it."),
    ])  # fmt: skip
    table.rows += [row_of(family, thousands, fastest=listed(best(analysis, family))) for family in found]
    return table


def _build_table(found: list[Family]) -> Table:
    table = Table(
        "builds", "Time to build an accelerator",
        "Milliseconds of the first build of a process, the loading of compiled code left out; "
        "geometric mean over blocks with a 95 % interval.",
        [HEADINGS["scene"], Column("primitives", "Primitives of the scene.", "count"),
         *value_columns(found, "Milliseconds to build {}.")],
    )  # fmt: skip
    for family in demanding(found):
        table.rows.append(row_of(family, _build_milliseconds, primitives=family.any.cells[0].get("primitives")))
    return table


def _build_milliseconds(contestant: Contestant) -> Estimate:
    builds = {cell["block"]: (cell.get("phases") or {}).get("build_seconds") or math.nan for cell in contestant.done}
    return estimate(builds, 1e3)
