"""What was measured, as documented tables: a row a checkpoint, and a row a cell. points.csv and phases.csv are these."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import pandas as pd

from harness.analysis.columns import Column, Table
from harness.analysis.model import CONTESTANT_KEYS, Frame
from harness.metrics import METRIC_MEANINGS
from harness.store.records import Cell, Machine
from harness.store.results import CHOICES, PHASES, Results, fixed_seconds, point_error

CONTESTANT = Column("contestant", "Engine and those settings that differ within this experiment.")
SCENE = Column("scene", "Scene that was rendered.")
IDENTITY = [
    SCENE,
    Column("engine", "Engine."),
    Column("engine_version", "The engine's version."),
    Column("accelerator", "Accelerator with its options."),
    Column("shader", "Shader with its options."),
    Column("sampler", "Sampler with its options."),
    Column("precision", "float64 or float32."),
    Column("threads", "Threads.", "count"),
    Column("width", "Pixels.", "count"),
    Column("height", "Pixels.", "count"),
    Column("label", "A/A label, empty for ordinary cells."),
    Column("division", "Division in which it is ranked: closed or open."),
]
CELL = [
    Column("cell_id", "Hash of the spec."),
    Column("env_id", "Hash of the machine and library versions."),
    Column("worker", "Address of the Dask worker that measured it; empty without a cluster."),
    *IDENTITY,
    Column("block", "Which repeat of the whole experiment it belongs to.", "count"),
    Column("seed", "Seed of the sampler.", "count"),
    Column("state", "done, failed, timeout or skipped."),
    Column("order", "Position of the cell in the run.", "count"),
]


OF_THE_CELL = {
    "primitives": ("Triangles, spheres and other shapes of the scene.", "count"),
    "reference_id": ("Hash of what the reference is made of.", "text"),
    "reference_shader": ("Shader of the reference with its options.", "text"),
    "smooth_sampler": ("Whether the sampler's error falls smoothly, as that of independent samples does.", "flag"),
    "reproducible": ("Whether the same seed gives the same errors at the same samples.", "flag"),
}
"""Columns of `cells` that are called as fields of `records.Cell` are: meaning and kind."""


def points(results: Results) -> Table:
    """One row a checkpoint of every cell that has one."""
    measured = [cell for cell in results.cells if cell.points]
    before = [
        CONTESTANT,
        *CELL,
        Column("spp", "Samples per pixel so far.", "count"),
        Column("seconds", "Seconds inside render calls so far (warm).", "number"),
        Column("cold_seconds", "The same with import, load, build and compilation.", "number"),
        Column("rays", "Rays so far.", "number"),
        Column(
            "error", "Error by the metric of the targets, corrected for the reference's noise where that is known.", "number"
        ),
        Column("error_se", "Its standard error by the noise of the reference.", "number"),
        Column("mean_spp", "Samples of a pixel on average: more than spp, of an engine that renders more.", "number"),
        Column("film_variance", "Variance of a pixel by the spread of the film's own samples, averaged.", "number"),
    ]
    after = [
        Column("separate_renders", "Whether seconds and rays come from a separate render.", "flag"),
        Column("contended", "Whether other work disturbed the timing.", "flag"),
        Column("image", "The checkpoint's image, relative to the results folder."),
    ]
    names = dict.fromkeys(key for cell in measured for point in cell.points for key in point.metrics)
    metrics = [Column(name, metric_meaning(name), "number") for name in names]
    contestants = _contestants(results)
    rows = []
    for cell in measured:
        shared = {**of_cell(cell), "contestant": contestants[cell.cell_id], "contended": cell.machine.contended}
        shared["separate_renders"], start = cell.separate_renders, fixed_seconds(cell)
        for point in cell.points:
            error, se = point_error(point, results.metric)
            of_point = {"cold_seconds": start + point.seconds, "error": error, "error_se": se, "mean_spp": point.samples}
            rows.append({**point.metrics, **dict(point), **shared, **of_point})
    taken = {column.name for column in (*before, *after)}
    columns = [*before, *(column for column in metrics if column.name not in taken), *after]
    return Table("points", "Checkpoints", "One row per checkpoint.", columns, rows)


def cells(results: Results) -> Table:
    """One row a cell, whatever became of it."""
    counters = dict.fromkeys(key for cell in results.cells for key in cell.counters)
    told = {name for cell in results.cells for name in cell.machine.model_fields_set}
    machine = {name: _kind_of(field.annotation) for name, field in Machine.model_fields.items() if name in told}
    columns = [
        CONTESTANT,
        *CELL,
        *(Column(name, meaning, kind) for name, (meaning, kind) in OF_THE_CELL.items()),
        *(Column(f"{phase}_seconds", f"Seconds of the phase {phase}.", "number") for phase in PHASES),
        Column("fixed_seconds", "Seconds of import, load, build and compilation together.", "number"),
        Column("warm_build_seconds", "Seconds of the second build, of the renderer that is timed.", "number"),
        *(Column(f"counter_{name}", f"The engine's counter {name}.", "number") for name in counters),
        *(Column(f"machine_{name}", f"The machine during the cell: {name}.", kind) for name, kind in machine.items()),
        Column("message", "Why it has no result."),
    ]
    contestants = _contestants(results)
    rows = [
        {
            **dict(cell.phases),
            **{name: getattr(cell, name) for name in OF_THE_CELL},
            "reference_shader": str(cell.reference_shader),
            "render_seconds": cell.render_seconds,
            "fixed_seconds": fixed_seconds(cell),
            **of_cell(cell),
            "contestant": contestants[cell.cell_id],
            **{f"counter_{name}": value for name, value in cell.counters.items()},
            **{f"machine_{name}": value for name, value in cell.machine},
            "message": cell.message,
        }
        for cell in results.cells
    ]
    return Table("phases", "Phases", "One row per cell.", columns, rows)


def by_contestant(frame: Frame, results: Results) -> Frame:
    """The rows of a DataFrame in the order of the contestants, and of each by block, if the rows have one."""
    names = [(c.settings.scene, c.name) for c in results.contestants]
    order = pd.DataFrame(names, columns=CONTESTANT_KEYS, dtype="string")
    return order.drop_duplicates().merge(frame.sort_values(["block"] * ("block" in frame), kind="stable"), on=CONTESTANT_KEYS)


def metric_meaning(name: str) -> str:
    """The sentence for a metric column: `relmse_e0.01_se` is looked up as `relmse_se`."""
    base, _, rest = name.partition("_e")
    if rest[:1].isdigit():
        _, _, suffix = rest.partition("_")
        return METRIC_MEANINGS.get(f"{base}_{suffix}" if suffix else base, name)
    return METRIC_MEANINGS.get("mean" if name.startswith("mean_") else name, name)


def _contestants(results: Results) -> dict[str, str]:
    """Cell id -> the name of its contestant."""
    return {cell.cell_id: contestant.name for contestant in results.contestants for cell in contestant.cells}


def of_cell(cell: Cell) -> Mapping[str, Any]:
    """A cell's values of the columns `CELL`."""
    settings = cell.settings
    texts = {axis: str(getattr(settings, axis)) for axis in CHOICES}
    plain = {column.name: getattr(cell, column.name) for column in CELL if column.name not in texts}
    return {**plain, **texts, "label": settings.label}


def _kind_of(annotation: Any) -> str:
    """The kind of a column whose values are of a type; some may be None."""
    kinds = {bool: "flag", int: "count", float: "number"}
    types = [getattr(kind, "__origin__", kind) for kind in (annotation, *get_args(annotation))]
    return next((kinds[kind] for kind in types if kind in kinds), "text")
