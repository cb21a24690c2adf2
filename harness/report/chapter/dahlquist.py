"""raybench's engines beside the port of Dahlquist's ray tracer, on his scene: what `configs/dahlquist.yaml` measured.

A sample is a frame: one primary ray through every pixel. Images are compared where balls are (`port_pictures`), because the
port shows a picture of its own where others see the sky.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from harness.analysis import Analysis, seconds_per_sample
from harness.report.chapter import figures, port_features, port_pictures
from harness.report.chapter.document import Paragraph, Section, TablePart
from harness.report.chapter.experiment import each_block, limits, place, verdicts
from harness.report.chapter.families import (
    Family,
    accelerator_name,
    compare,
    estimate,
    families_along,
    ranking,
    speedups,
    thousands,
)
from harness.report.chapter.texts import listed
from harness.report.tables import Column, Table
from harness.statistics import Estimate, Ratio
from harness.store.results import Contestant, choices_of, name_words


class Rival(NamedTuple):
    """A contestant by the name of its engine and accelerator; `speedup` over the port's fastest under the same settings is
    None where that is itself, or where either was not measured."""

    name: str
    contestant: Contestant
    speedup: Ratio | None


def section(analysis: Analysis, plots: Path) -> Section:
    """The section of one results folder; its figures are written into `plots`."""
    made = Section("Beside Dahlquist's ray tracer", [Paragraph(_setting(analysis))])
    families = families_along(analysis, "accelerator")
    rivals = _rivals(analysis, families)
    if any(rival.contestant.done for rival in rivals):
        made.sections += [
            _frames(analysis, rivals, plots),
            port_pictures.section(analysis, [(rival.name, rival.contestant) for rival in rivals], plots),
            port_features.section(analysis),
        ]
    made.sections.append(limits(analysis))
    return made


def _setting(analysis: Analysis) -> list[str]:
    measured = [contestant for contestant in analysis.results.contestants if contestant.done]
    if not measured:
        return ["Nothing was measured."]
    blocks = {cell.block for contestant in measured for cell in contestant.done}
    sizes = sorted({contestant.settings.size for contestant in measured})
    return [
        f"The engines of raybench rendered the scene of Dahlquist's ray tracer beside a port of that program, at "
        f"{listed(sizes)} pixels.",
        "A sample is a frame: one primary ray through every pixel.",
        *place(analysis),
        f"Every configuration was measured once{each_block(len(blocks))}.",
        f"Times are those of rendering alone, and compared block by block. {verdicts(analysis)}",
    ]


def _rivals(analysis: Analysis, families: Sequence[Family]) -> list[Rival]:
    """Every contestant that is no A/A twin, measured or not."""
    racing = [c for c in analysis.results.contestants if not c.settings.label]
    choices = choices_of(racing)
    rivals = []
    for contestant in racing:
        words = name_words(contestant, choices)
        family = next((f for f in families if any(c is contestant for c in f.members.values())), None)
        port = None if family is None else _fastest_port(family)
        speedup = None
        if family is not None and port is not None and family.members[port] is not contestant:
            own = next(name for name, member in family.members.items() if member is contestant)
            speedup = compare(analysis, family, own, port)
        rivals.append(Rival(accelerator_name(words["engine"], words["accelerator"]), contestant, speedup))
    return rivals


def _fastest_port(family: Family) -> str | None:
    """The port's configuration with the least mean time."""
    return next((name for name in ranking(family) if family.members[name].settings.engine == port_features.PORT), None)


# ---- frames ----------------------------------------------------------------------------------------------------------


def _frames(analysis: Analysis, rivals: Sequence[Rival], plots: Path) -> Section:
    measured = [(rival.name, rival.contestant) for rival in rivals if rival.contestant.done]
    return Section("Frames", [TablePart(_frame_table(analysis, rivals)), *figures.part(figures.frame_times(measured, plots))])


def _frame_table(analysis: Analysis, rivals: Sequence[Rival]) -> Table:
    sizes = {rival.contestant.settings.size for rival in rivals}
    table = Table(
        "frames",
        "Frame times and primary rays",
        "Geometric means over blocks with 95 % intervals. Against the port: how many times as fast as its fastest "
        "configuration with the same number of threads; gain: over the fewest threads; both paired by block.",
        [
            Column("name", "Engine and accelerator.", title="engine and accelerator"),
            *([Column("size", "Pixels.")] if len(sizes) > 1 else []),
            Column("threads", "Threads.", "count"),
            Column("frame_ms", "Milliseconds per frame.", "estimate", "frame [ms]"),
            Column("primary_rays", "Million primary rays per second.", "estimate", "million primary rays/s"),
            Column("against", "Speed over that of the port's fastest.", "estimate", "against the port"),
            Column("gain", "Speed over that of the same with the fewest threads.", "estimate", "gain of threads"),
        ],
    )
    gains = _gains(analysis)
    for name, contestant, speedup in rivals:
        row: dict[str, Any] = {"name": name, "size": contestant.settings.size, "threads": contestant.settings.threads}
        if contestant.done:
            rate = thousands(contestant)
            row["frame_ms"] = estimate(seconds_per_sample(contestant), 1e3)
            row["primary_rays"] = Estimate(rate.value / 1e3, rate.low / 1e3, rate.high / 1e3, rate.n)
        row["against"] = speedup and Estimate(*speedup[:4])
        row["gain"] = gains.get(contestant)
        table.rows.append(row)
    return table


def _gains(analysis: Analysis) -> dict[Contestant, Estimate]:
    """Contestant -> its speed over that of the one with the fewest threads."""
    gains = {}
    for family in families_along(analysis, "threads"):
        fewest = min(family.members, key=lambda name: family.members[name].settings.threads)
        gains |= {family.members[name]: gain for name, gain in speedups(analysis, family, fewest).items()}
    return gains
