"""The experiment of the dissertation: accelerators, threads, shaders and samplers over its scenes.

Every number and every verdict in the text comes from the results; what was not varied is left out.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd

from harness.analysis import Analysis, frames
from harness.report.chapter import accelerators, samplers, shaders, threads
from harness.report.chapter.document import Listing, Paragraph, Section
from harness.report.chapter.sentences import error_name, listed, plural
from harness.report.tables.evidence import floors_text

VERDICTS = (
    "Intervals are at 95 % for one pair; that one is called faster, beyond the noise floor, holds at 95 % for all pairs of "
    "a comparison together. Where the 90 % interval of a ratio lies within 5 % of equality the two are called the same; all "
    "else is unresolved."
)
TOPICS = (accelerators, threads, shaders, samplers)


def section(analysis: Analysis, plots: Path) -> Section:
    """The section of one results folder; its figures are written into `plots`."""
    made = Section("The experiment", [Paragraph(_setting(analysis))])
    for topic in TOPICS:
        below = topic.section(analysis, plots)
        if below is not None:
            made.sections.append(below)
    made.sections.append(limits(analysis, _bias(analysis)))
    return made


def _setting(analysis: Analysis) -> list[str]:
    results = analysis.results
    settings = [c.settings for c in results.contestants if c.done and not c.settings.label]
    if not settings:
        return ["Nothing was measured."]
    blocks = {cell["block"] for contestant in results.contestants for cell in contestant.done}
    used, names = {(s.engine, s.accelerator) for s in settings}, {s.engine for s in settings}
    varied = {
        "engine" if len(used) == len(names) else "accelerator": len(used), "thread count": len({s.threads for s in settings}),
        "shader": len({s.shader for s in settings}), "sampler": len({s.sampler for s in settings}),
    }  # fmt: skip
    sizes = sorted({s.size for s in settings})
    return [
        f"{plural(len(results.scenes), 'scene')} {'was' if len(results.scenes) == 1 else 'were'} rendered with "
        f"{listed([plural(number, noun) for noun, number in varied.items()])}, {len(settings)} configurations in all, "
        f"at {listed(sizes)} pixels.",
        *place(analysis),
        f"Every configuration was measured once{each_block(len(blocks))}{', with another seed in each' * (len(blocks) > 1)}.",
        "Times are those of rendering alone.",
        f"Speeds of two configurations are compared block by block. {VERDICTS} {floors_text(analysis)}",
        f"Errors are {error_name(results.metric)} against references of many samples, corrected for the references' own noise.",
    ]


def each_block(blocks: int) -> str:
    """How the measurements were laid out, as the end of a clause."""
    return f" in each of {blocks} blocks, in random order" if blocks > 1 else ", in random order"


def place(analysis: Analysis) -> list[str]:
    """On what machine it was measured."""
    machine = analysis.results.manifest.get("machine") or {}
    cores = machine.get("usable_cores") or machine.get("cores")
    cpu = machine.get("cpu") or "an unnamed processor"
    return [f"The machine was {cpu}{f' with {cores} usable cores' if cores else ''}."]


def limits(analysis: Analysis, *more: str) -> Section:
    """What did not run, how quiet the machine was, what is noise; and `more` of the same kind."""
    results = analysis.results
    cells = frames.by_contestant(frames.cells(results).frame, results)
    counted = listed([f"{number} {state}" for state, number in cells.state.value_counts().sort_index().items()])
    said = [f"Of {plural(len(cells), 'cell')}, {counted}."]
    missing = set(results.manifest.get("cell_ids") or ()) - set(cells.cell_id)
    if missing:
        said.append(f"{plural(len(missing), 'cell')} of the experiment had not been begun.")
    contended = sum(bool((cell.get("machine") or {}).get("contended")) for cell in results.cells)
    said.append(f"{plural(contended, 'cell')} shared the machine with other work while being timed." if contended
                else "No cell shared the machine with other work while being timed.")  # fmt: skip
    parts: list[Any] = [Paragraph([*said, *more])]
    reasons = _reasons(cells)
    return Section("What else to know", [*parts, Listing(reasons)] if reasons else parts)


def _bias(analysis: Analysis) -> str:
    """Which configurations converge to another image than the reference, as far as it was tested."""
    tested = [
        verdict for verdict in analysis.verdicts if verdict.bias is not None and not math.isnan(verdict.bias.squared)
    ]
    if not tested:
        return "Whether images converge to those of the references was not tested: it takes images of several seeds."
    biased = [verdict.contestant for verdict in tested if verdict.bias is not None and verdict.bias.flags]
    number = plural(len(tested), "configuration")
    if not biased:
        return f"Of {number} none was found to converge to another image than its reference."
    names = sorted({f"{contestant.name} on {contestant.settings.scene}" for contestant in biased})
    shown = [*names[:5], f"{len(names) - 5} more"] if len(names) > 6 else names
    return f"Of {number} {len(biased)} converge to another image than the reference, by three standard errors: {listed(shown)}."


def _reasons(cells: pd.DataFrame) -> list[str]:
    """Who was not measured, and why, in the engine's words."""
    failed = cells[(cells.state != "done") & cells.message.fillna("").ne("")]
    who = (failed.contestant + " on " + failed.scene).groupby([failed.state, failed.message], sort=False).unique()
    return [f"{listed(list(names))}: {state}, {message}." for (state, message), names in who.items()]
