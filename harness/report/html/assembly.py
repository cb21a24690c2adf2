"""Puts tables, plots, images and provenance into one HTML file that needs no network and no other file."""

from __future__ import annotations

import base64
import functools
import json
import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from harness.analysis import Analysis, calibration, reports_its_time
from harness.analysis.certificates import certificate_text, certifies, refutes
from harness.analysis.rays import RayContestant, ray_races
from harness.metrics import error_words, metric_title
from harness.report.html.axes import axis_tables
from harness.report.html.glossary import TERMS, anchor
from harness.report.html.noise import noise_panels
from harness.report.html.overview import JudgedReference, colour_key, matrix
from harness.report.html.pictures import picture_groups
from harness.report.plots import Picture, Plot
from harness.report.plots.catalogue import OF_A_PANEL
from harness.report.plots.chart import Chart
from harness.report.plots.interactive import plotly
from harness.report.plots.panels import panels
from harness.report.plots.rays import RAYS
from harness.report.plots.style import file_stem, formats
from harness.report.sentences import MOST_LINES, sentences
from harness.report.tables import Column, Table, cell_text, sort_value
from harness.report.tables.evidence import evidence
from harness.report.winners import tally, winners
from harness.store.records import AnyCell, Cell, RayCell
from harness.store.results import Contestant, Results, fixed_seconds, point_error

MOST_BYTES = 9_500_000
"""The report stays under 10 MB; pictures get what the rest leaves, at least a tenth of it and at most 6 MB."""
MOST_WINNERS = 6
"""Scenes and targets that the first lines tell one by one; of more they count who is first how often."""
SCRIPTS = ("theme.js", "table.js", "decode.js", "plots.js", "colours.js", "viewer.js")
LIBRARY = "plotly-basic.min.js"
"""The file `plotly-basic.min.js` of the package plotly.js-basic-dist-min of npm, as it is there."""
QUESTIONS = {
    True: "Which contestant reaches a given error first?",
    False: "Which engine answers most rays per second, and which of the answers are wrong?",
}
"""Where the config has none: of results with cells that render, and of those without."""
VERDICT_CLASSES = {
    "faster": "good",
    "equivalent": "good",
    "slower": "bad",
    "different": "bad",
    "failed": "bad",
    "timeout": "bad",
    "shallower": "bad",
    "same": "equal",
    "unresolved": "even",
    "unknown": "even",
    "skipped": "even",
    "done": "good",
    "identical": "good",
    "pass": "good",
    "xfail": "even",
    "fail": "bad",
}


def report_html(
    analysis: Analysis, tables: Sequence[Table], plots: Sequence[Plot | Picture], problems: Sequence[str] = ()
) -> str:
    """The whole report as one document. `problems` say what is not in it."""
    cells = cell_table(analysis)
    sets, code = plot_sets(analysis, plots), library() if plots else ""
    left = MOST_BYTES - len(code) - sum(len(figure) for _, figures in sets for _, _, figure in figures) - 400 * len(cells.rows)
    groups = picture_groups(analysis, min(max(left, MOST_BYTES / 10), 6e6))
    renders = "time_to_quality" in {table.name for table in tables}
    results, found = analysis.results, calibration.calibrate(analysis, calibration.OF_REPORTS)
    references = _references(results)
    first = winners(analysis)
    many = len(first) > MOST_WINNERS
    said = sentences(analysis, beside_winners=not many)
    pictures = {"groups": [group.payload for group in groups], "maps": colour_maps()}
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=results.config.name or results.folder.name,
            question=results.config.question or QUESTIONS[renders],
            renders=renders,
            matrix=matrix(analysis, found, references),
            colour_key=colour_key(analysis),
            winners=first,
            tally=tally(first) if many else "",
            many=many,
            answers=[each for each in said if each.known],
            most_answers=MOST_LINES,
            unanswered=[each for each in said if not each.known],
            axis_tables=axis_tables(analysis),
            tables={table.name: table for table in tables},
            pair_verdicts=_pair_verdicts(analysis),
            plot_sets=sets,
            library=code,
            problems=problems,
            plot_files=bool(formats()),
            groups=groups,
            noise=noise_panels(analysis),
            payload=_script_json(pictures),
            cells=cells,
            machines=_machines(analysis),
            runs=results.runs,
            references=references,
            terms=TERMS,
            manifest=json.dumps(results.manifest.model_dump(exclude_unset=True), indent=2, default=str),
            counts=_state_counts(analysis),
            missed=calibration.missed(found),
            figures=calibration.figures(found),
            rests_on=calibration.rests_on(found),
            metric=metric_title(results.metric),
            short_metric=metric_title(results.metric).partition(" (")[0],
            error_words=error_words(results.metric),
            evidence=evidence(analysis),
            style=Markup(_asset("report.css")),
            scripts=Markup("\n".join(_asset(name) for name in SCRIPTS)),
        )
    )


def plot_sets(analysis: Analysis, plots: Sequence[Plot | Picture]) -> list[tuple[str, list[tuple[str, str, Markup]]]]:
    """(title, [(label, name, figure)]) of each panel, and of the plots of all scenes: of a set the page shows one plot at a
    time."""
    left = {plot.name: plot for plot in plots}
    found = []
    for panel in panels(analysis):
        names = {file_stem(start, panel.title): label for start, label in OF_A_PANEL.items()}
        found.append((panel.title, [(label, left.pop(name)) for name, label in names.items() if name in left]))
    for title, start in (("Rays", RAYS), ("All scenes", "")):
        names = [name for name in left if name.startswith(start)]
        found.append((title, [(plot.title, plot) for plot in map(left.pop, names)]))
    return [(title, [(label, plot.name, plot_figure(plot)) for label, plot in own]) for title, own in found if own]


def plot_figure(plot: Plot | Picture) -> Markup:
    """A plot as an element of a page: what plots.js draws, or an image."""
    return Markup(_environment().get_template("plot.html.j2").render(plot=plot, suffixes=formats()))


def colour_maps() -> dict[str, list[list[int]]]:
    """Stops of the viewer's false colours, as [red, green, blue] from 0 to 255."""
    from matplotlib import colormaps

    names = {"magma": "magma", "signed": "RdBu_r"}
    shares = np.linspace(0.0, 1.0, 64)
    return {key: (255 * colormaps[name](shares)[:, :3]).round().astype(int).tolist() for key, name in names.items()}


def cell_table(analysis: Analysis) -> Table:
    """Every cell with its last checkpoint and the command that repeats it."""
    results = analysis.results
    table = Table(
        "cells",
        "Every cell",
        "One row per cell; the command renders it again.",
        [
            Column("state", "done, failed, timeout or skipped."),
            Column("scene", "Scene."),
            Column("contestant", "Engine and the settings that vary."),
            Column("block", "Repeat.", "count"),
            Column("seed", "Seed of the sampler.", "count"),
            Column("spp", "Samples per pixel at the end.", "count"),
            Column("seconds", "Warm seconds at the end.", "number", "warm [s]"),
            Column("cold", "Seconds with import, load, build and compilation.", "number", "cold [s]"),
            Column("error", f"{metric_title(results.metric)} at the end, {error_words(results.metric)}.", "number"),
            Column("note", "Message, what disturbed the timing, or that a program reported its own time."),
            Column("command", "Repeats the cell."),
        ],
    )
    for contestant in results.contestants:
        for cell in contestant.cells:
            table.rows.append(_cell_row(analysis, contestant, cell))
    table.rows += [_ray_cell_row(one, cell) for race in ray_races(results) for one in race for cell in one.cells]
    return table


def _ray_cell_row(one: RayContestant, cell: RayCell) -> dict[str, Any]:
    return {
        **_shared_row(cell),
        "contestant": " ".join(
            filter(None, [one.settings.engine, one.variant, f"{one.settings.rays} rays", one.settings.label])
        ),
        **({"seconds": cell.seconds, "cold": cell.seconds + fixed_seconds(cell)} if cell.passes else {}),
    }


def _shared_row(cell: AnyCell) -> dict[str, Any]:
    notes = [cell.message, "contended" if cell.machine.contended else ""]
    return {
        "state": cell.state,
        "scene": cell.scene,
        "block": cell.block,
        "seed": cell.seed,
        "command": cell.command,
        "note": "; ".join(note for note in notes if note),
    }


def _cell_row(analysis: Analysis, contestant: Contestant, cell: Cell) -> dict[str, Any]:
    row = _shared_row(cell) | {"contestant": contestant.name}
    if reports_its_time(cell):
        row["note"] = "; ".join(filter(None, [row["note"], "time reported by the program"]))
    if cell.points:
        end = cell.end
        row |= {
            "spp": end.spp,
            "seconds": end.seconds,
            "cold": end.seconds + fixed_seconds(cell),
            "error": point_error(end, analysis.results.metric)[0],
        }
    return row


def svg_address(svg: str) -> str:
    """SVG text as an address that an image may have."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"


def plot_json(chart: Chart) -> Markup:
    """A chart for plots.js."""
    return _script_json(plotly(chart), separators=(",", ":"))


def library() -> Markup:
    """The code of Plotly, deflated, in base64: plots.js reads it when the first plot is drawn."""
    return Markup(base64.b64encode(zlib.compress(_asset(LIBRARY).encode(), 9)).decode())


@functools.cache
def _environment() -> Environment:
    environment = Environment(
        loader=FunctionLoader(_asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals |= {
        "anchor": anchor,
        "blank": blank,
        "breakable": breakable,
        "cell_text": cell_text,
        "plot_json": plot_json,
        "shown_columns": shown_columns,
        "sort_value": sort_value,
        "svg_address": svg_address,
        "verdict_class": verdict_class,
    }
    return environment


def shown_columns(table: Table) -> list[Column]:
    """Those of which something is known in some row; all of a table without rows."""
    return [c for c in table.columns if not table.rows or any(cell_text(c, row.get(c.name)) != "–" for row in table.rows)]


def blank(row: Mapping[str, Any], column: Column) -> str:
    """Why a cell of a table shows nothing, as far as the table says so."""
    return row.get("blank", {}).get(column.name, "")


def breakable(name: str) -> Markup:
    """A name whose line may break after an underscore."""
    return Markup("<wbr>").join(re.split(r"(?<=_)", name))


def verdict_class(value: Any) -> str:
    """The CSS class of a verdict word; flagged and warning texts are bad news."""
    text = str(value or "")
    return VERDICT_CLASSES.get(text, "bad" if "flagged" in text or "floor" in text or "too good" in text else "")


def _asset(name: str) -> str:
    return (files("harness.report.html") / name).read_text(encoding="utf-8")


def _script_json(value: Any, **options: Any) -> Markup:
    """JSON that may stand inside a script element."""
    text = json.dumps(value, allow_nan=False, **options).replace("<", "\\u003c").replace("\u2028", "\\u2028")
    return Markup(text)


def _pair_verdicts(analysis: Analysis) -> list[tuple[str, int]]:
    """(verdict, how many pairs of engines have it), the worst first."""
    order = ("different", "unresolved", "unknown", "equivalent", "identical")
    counts = Counter(pair.verdict for pair in analysis.engine_pairs)
    return [(verdict, counts[verdict]) for verdict in order if counts[verdict]]


def _references(results: Results) -> list[JudgedReference]:
    """The references, each with what its certificate says and whether that is bad news."""
    found = []
    for reference_id, reference in results.references.items():
        certificate = results.certificates.get(reference_id)
        said = certificate_text(certificate) if certificate else "uncertified: no engine of another lineage has made its image"
        certified, refuted = (bool(certificate and judge(certificate)) for judge in (certifies, refutes))
        found.append(JudgedReference(reference, said, certified, refuted))
    return found


def _machines(analysis: Analysis) -> list[str]:
    """The measured cells' environments in words: more than one must not share a time axis in silence."""
    results = analysis.results
    known = {env_id: environment.preimage for env_id, environment in results.environments.items()}
    found = sorted({cell.env_id for cell in results.all_cells if cell.state == "done"})
    return [machine_words(env_id, known.get(env_id, {})) for env_id in found]


def machine_words(env_id: str, preimage: Mapping[str, Any]) -> str:
    """`1a2b3c4d: AMD EPYC 7763, 2 cores, Linux 6.8, Python 3.12`, as far as it is known."""
    cores, system = preimage.get("usable_cores"), f"{preimage.get('system', '')} {preimage.get('kernel', '')}".strip()
    python = preimage.get("python")
    parts = [preimage.get("cpu"), f"{cores} cores" if cores else "", system, f"Python {python}" if python else ""]
    words = ", ".join(str(word) for word in parts if word)
    return ": ".join(filter(None, [env_id[:8], words]))


def _state_counts(analysis: Analysis) -> dict[str, int]:
    return dict(sorted(Counter(cell.state for cell in analysis.results.all_cells).items()))
