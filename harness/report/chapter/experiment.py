"""The tables and figures of an experiment: accelerators, threads, shaders and samplers over its scenes.

What was not varied is left out. The tables hold numbers and who may be best; what they mean is for prose to say.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from harness.analysis import Analysis, error_targets
from harness.analysis.calibration import plural
from harness.analysis.equivalence import common_spp
from harness.analysis.scaling import primitives
from harness.report.chapter import figures, measures
from harness.report.chapter.document import Listing, Paragraph, Section, TablePart
from harness.report.chapter.families import (
    HEADINGS,
    Family,
    best,
    demanding,
    estimate,
    families_along,
    identity,
    pixels,
    row_of,
    speedups,
    thousands,
    usual,
    value_columns,
    values,
)
from harness.report.chapter.texts import WORST, error_name, listed
from harness.report.tables import Column, Table
from harness.report.tables.evidence import spread_text
from harness.statistics import Estimate
from harness.store.records import AnyCell
from harness.store.results import Contestant, Results


def section(analysis: Analysis, plots: Path) -> Section:
    """The section of one results folder; its figures are written into `plots`."""
    made = Section("The experiment", [Paragraph(_setting(analysis))])
    for topic in (_accelerators, _threads, _shaders, _samplers, _tails):
        below = topic(analysis, plots)
        if below is not None:
            made.sections.append(below)
    made.sections.append(limits(analysis))
    return made


# ---- how it was measured ---------------------------------------------------------------------------------------------


def _setting(analysis: Analysis) -> list[str]:
    results = analysis.results
    settings = [c.settings for c in results.contestants if c.done and not c.settings.label]
    if not settings:
        return ["Nothing was measured."]
    blocks = {cell.block for contestant in results.contestants for cell in contestant.done}
    return [
        f"{plural(len(settings), 'configuration')} on {plural(len(results.scenes), 'scene')}, at "
        f"{listed(sorted({s.size for s in settings}))} pixels.",
        *place(analysis),
        f"Every configuration was measured once{each_block(len(blocks))}{', with another seed in each' * (len(blocks) > 1)}.",
        "Times are those of rendering alone.",
        f"Speeds of two configurations are compared block by block. {verdicts(analysis)}",
        f"Errors are {error_name(results.metric)} against references of many samples, corrected for the references' own noise.",
    ]


def verdicts(analysis: Analysis) -> str:
    """What the verdicts on pairs mean, and the persistent spread that they consider: some sentences."""
    return (
        "Intervals are at 95 % for one pair. The verdict faster holds at 95 % for all pairs of a comparison together. Where "
        "the 90 % interval of a ratio lies within "
        f"{100 * analysis.results.config.same_within:g} % of equality the two are called the same; all else is unresolved. "
        f"{spread_text(analysis)}"
    )


def each_block(blocks: int) -> str:
    """How the measurements were laid out, as the end of a clause."""
    return f" in each of {blocks} blocks, in random order" if blocks > 1 else ", in random order"


def place(analysis: Analysis) -> list[str]:
    """On what machine it was measured, and when."""
    machine = analysis.results.manifest.machine
    cores = machine.get("usable_cores") or machine.get("cores")
    cpu = machine.get("cpu") or "an unnamed processor"
    days = sorted({cell.time[:10] for cell in analysis.results.all_cells if cell.time})
    when = f", on {' to '.join(dict.fromkeys((days[0], days[-1])))}" if days else ""
    size = f" with {plural(cores, 'usable core')}" if cores else ""
    return [f"The machine was {cpu}{size}{when}."]


def limits(analysis: Analysis) -> Section:
    """What did not run, and how quiet the machine was."""
    results = analysis.results
    cells = results.all_cells
    states = sorted(Counter(cell.state for cell in cells).items())
    said = [f"Of {plural(len(cells), 'cell')}, {listed([f'{number} {state}' for state, number in states])}."]
    missing = set(results.manifest.cell_ids) - {cell.cell_id for cell in cells}
    if missing:
        said.append(f"{plural(len(missing), 'cell')} of the experiment had not been begun.")
    contended = contended_cells(analysis)
    said.append(
        f"{plural(contended, 'cell')} shared the machine with other work while being timed."
        if contended
        else "No cell shared the machine with other work while being timed."
    )
    reasons = _reasons(results)
    return Section("What else to know", [Paragraph(said), *([Listing(reasons)] if reasons else [])])


def contended_cells(analysis: Analysis) -> int:
    return sum(bool(cell.machine.contended) for cell in analysis.results.all_cells)


def _reasons(results: Results) -> list[str]:
    """Who was not measured, and why, in the engine's words."""
    named: list[tuple[AnyCell, str]] = [(cell, c.name) for c in results.contestants for cell in c.cells]
    named += [(cell, f"{cell.engine} with {cell.rays} rays") for cell in results.ray_cells]
    who: dict[tuple[str, str], dict[str, None]] = {}
    for cell, name in named:
        if cell.state != "done" and cell.message:
            who.setdefault((cell.state, cell.message), {})[f"{name} on {cell.scene}"] = None
    return [f"{listed(list(names))}: {state}, {message}." for (state, message), names in who.items()]


# ---- tables and figures ----------------------------------------------------------------------------------------------


def _most_threads(families: list[Family]) -> tuple[list[Family], str]:
    """The families with the most threads, and how many that are, in words."""
    most = max(family.any.settings.threads for family in families)
    return [family for family in families if family.any.settings.threads == most], plural(most, "thread")


def _accelerators(analysis: Analysis, plots: Path) -> Section | None:
    """Which finds hits fastest, on which scene, and what it takes to build."""
    every = families_along(analysis, "accelerator")
    if not every:
        return None
    families, threads = _most_threads(every)
    speeds = Table(
        "accelerators",
        "Samples per second by accelerator",
        f"Thousands of paths (samples of a pixel) per second with {threads}; geometric mean over blocks with a 95 % interval. "
        "Fastest: all that may be it.",
        [
            *identity(families),
            _primitives(),
            *value_columns(families, "Thousands of paths per second of {}."),
            Column("fastest", "The fastest, or all that may be it."),
        ],
    )
    builds = Table(
        "builds",
        "Time to build an accelerator",
        "Milliseconds of a build in a process that has built, compiled and rendered the scene before; geometric mean over "
        "blocks with a 95 % interval.",
        [HEADINGS["scene"], _primitives(), *value_columns(families, "Milliseconds to build {}.")],
    )
    for family in families:
        fastest = listed(best(analysis, family))
        speeds.rows.append(row_of(family, thousands, primitives=primitives(family.any), fastest=fastest))
    shown = demanding(families)
    for family in shown:
        build = partial(measures.build_milliseconds, analysis)
        builds.rows.append(row_of(family, build, primitives=primitives(family.any)))
    parts = [TablePart(speeds), *figures.part(figures.speeds(shown, plots))]
    if any(isinstance(cell, Estimate) and cell.n for row in builds.rows for cell in row.values()):
        parts.append(TablePart(builds))
    return Section("Accelerators", parts)


def _primitives() -> Column:
    return Column("primitives", "Primitives of the scene.", "count")


def _threads(analysis: Analysis, plots: Path) -> Section | None:
    """How much more threads give."""
    families = families_along(analysis, "threads")
    if not families:
        return None
    names = sorted(values(families), key=lambda value: int(value.split()[0]))
    table = Table(
        "threads",
        f"Speed-up over {names[0]}",
        "Paired by block, with 95 % intervals; efficiency 1 is ideal.",
        [
            *identity(families),
            *(Column(name, f"Speed-up of {name}.", "estimate", name) for name in names[1:]),
            Column("efficiency", f"Speed-up of {names[-1]} over the share of threads.", "number"),
        ],
    )
    table.rows += [_thread_row(analysis, family, names) for family in families]
    return Section("Threads", [TablePart(table), *figures.part(figures.thread_gains(analysis, families, names, plots))])


def _thread_row(analysis: Analysis, family: Family, names: list[str]) -> dict[str, Any]:
    gains = speedups(analysis, family, names[0])
    row: dict[str, Any] = {**family.held, **gains}
    if gains:
        most = max(gains, key=names.index)
        row["efficiency"] = gains[most].value * int(names[0].split()[0]) / int(most.split()[0])
    return row


def _shaders(analysis: Analysis, plots: Path) -> Section | None:
    """What a sample costs by each rule of light transport. Their images differ, so that speed is not a merit."""
    families = families_along(analysis, "shader")
    if not families:
        return None
    most, threads = _most_threads(families)
    shown = usual(most, "sampler")
    table = Table(
        "shaders",
        "Cost of a sample by shader",
        f"Nanoseconds per path (a sample of a pixel) with {threads}; geometric mean over blocks with a 95 % interval. Sampler: "
        f"{shown[0].held['sampler']}. The shaders make different images.",
        [*identity(shown), *value_columns(shown, "Nanoseconds per path of {}.")],
    )
    table.rows += [row_of(family, nanoseconds) for family in shown]
    return Section("Shaders", [TablePart(table)])


def nanoseconds(contestant: Contestant) -> Estimate:
    """Of a path (a sample of a pixel): geometric mean over blocks with its interval."""
    rate = thousands(contestant)
    return Estimate(1e6 / rate.value, 1e6 / rate.high, 1e6 / rate.low, rate.n)


def _samplers(analysis: Analysis, plots: Path) -> Section | None:
    """Whose error is smaller, at the same number of samples and in the same time."""
    families = families_along(analysis, "sampler")
    if not families:
        return None
    errors = Table(
        "samplers",
        "Error at the same number of samples",
        f"{error_name(analysis.results.metric)}; geometric mean over seeds with a 95 % interval. Errors that the reference's "
        "noise hides are left out. Least: all that may have it.",
        [
            *identity(families),
            Column("spp", "Samples per pixel.", "count"),
            *value_columns(families, "Error of {}."),
            Column("least", "The least error."),
        ],
    )
    times = Table(
        "sampler_times",
        "Time to a quality by sampler",
        f"Seconds of rendering until the hardest target that all reach, in {error_name(analysis.results.metric)}; geometric "
        "mean over seeds with a 95 % interval.",
        [
            *identity(families),
            Column("target", "Quality to reach.", "exact"),
            *value_columns(families, "Seconds of {}.", "{} [s]"),
        ],
    )
    for family in families:
        spp = common_spp(*family.members.values())
        error = measures.errors_at(analysis, spp)
        least = listed(best(analysis, family, error))
        errors.rows.append(row_of(family, lambda c, error=error: estimate(error.values(c)), spp=spp, least=least))
        index = measures.hardest_target(analysis, family)
        if index is not None:
            seconds = measures.times_to(analysis, family, index).values
            target = error_targets(analysis.results)[index]
            times.rows.append(row_of(family, lambda c, seconds=seconds: estimate(seconds(c)), target=target))
    drawn = figures.part(figures.sampler_errors(analysis, families, plots))
    return Section("Samplers", [TablePart(errors), *drawn, *([TablePart(times)] if times.rows else [])])


def _tails(analysis: Analysis, plots: Path) -> Section | None:
    """How few pixels hold the error: of one configuration a scene and shader, the first that most have."""
    shown = measures.one_a_scene_and_shader(analysis)
    table = Table(
        "tails",
        "Error with and without the worst pixels",
        f"relMSE at a number of samples, not corrected for the reference's noise, and the same without the {WORST} of pixels "
        "where it is largest; geometric means over seeds with 95 % intervals. Share: what these pixels hold of it.",
        [
            HEADINGS["scene"],
            HEADINGS["shader"],
            Column("spp", "Samples per pixel.", "count"),
            Column("whole", "relMSE.", "estimate", "relMSE"),
            Column("trimmed", f"relMSE without the worst {WORST} of pixels.", "estimate", "without the worst"),
            Column("share", f"Share of relMSE in the worst {WORST} of pixels.", "percent"),
        ],
    )
    spp = common_spp(*(contestant for _, contestant in shown))
    for held, contestant in shown:
        whole, trimmed = measures.errors_untrimmed_and_trimmed(analysis, contestant, spp)
        if whole.n and whole.value > 0:
            share = measures.share_of_the_worst(whole.value, trimmed.value, pixels(contestant))
            table.rows.append({**held, "spp": spp, "whole": whole, "trimmed": trimmed, "share": share})
    if not table.rows:
        return None
    return Section("Where the error is", [TablePart(table), *figures.part(figures.tails(table, plots))])
