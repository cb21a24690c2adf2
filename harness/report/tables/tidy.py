"""points.csv, ttq.csv and phases.csv: tidy data for one's own analysis, every column documented."""

from __future__ import annotations

from typing import Any

from harness.analysis import Analysis
from harness.metrics import METRIC_MEANINGS
from harness.report.tables.model import Column, Table
from harness.store.results import PHASES, Event, Results, phase_seconds, settings_of

IDENTITY = [
    Column("scene", "Scene that was rendered."),
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
]
CELL = [
    Column("cell_id", "Hash of the spec."),
    Column("env_id", "Hash of the machine and library versions."),
    *IDENTITY,
    Column("block", "Which repeat of the whole experiment it belongs to.", "count"),
    Column("seed", "Seed of the sampler.", "count"),
]


def points(results: Results) -> Table:
    """One row a checkpoint of every cell that has one."""
    cells = [cell for cell in results.cells if cell.get("points")]
    names = list(dict.fromkeys(key for cell in cells for point in cell["points"] for key in point.get("metrics") or {}))
    columns = [
        *CELL, Column("state", "done, or timeout where the cell was cut short."),
        Column("order", "Position of the cell in the run.", "count"),
        Column("spp", "Samples per pixel so far.", "count"),
        Column("seconds", "Seconds inside render calls so far (warm).", "number"),
        Column("cold_seconds", "The same with import, load, build and compilation.", "number"),
        Column("rays", "Rays so far.", "number"),
        *(Column(name, metric_meaning(name), "number") for name in names),
        Column("contended", "Whether another worker ran beside it."),
        Column("image", "The checkpoint's image, relative to the results folder."),
    ]  # fmt: skip
    table = Table("points", "Checkpoints", "One row a checkpoint.", columns)
    for cell in cells:
        fixed = sum(phase_seconds(cell, phase) for phase in PHASES[:-1])
        for point in cell["points"]:
            table.rows.append({
                **_cell(cell), "spp": point["spp"], "seconds": point["seconds"],
                "cold_seconds": fixed + point["seconds"], "rays": point.get("rays"), **(point.get("metrics") or {}),
                "contended": (cell.get("machine") or {}).get("contended"), "image": point.get("image"),
            })  # fmt: skip
    return table


def quality_times(analysis: Analysis) -> Table:
    """One row a contender, target and start (warm or cold)."""
    table = Table(
        "ttq", "Time to quality", "One row a contender, target and start.",
        [*IDENTITY, Column("metric", "Metric of the target."), Column("target", "Value to reach.", "exact"),
         Column("start", "warm: rendering alone; cold: with import, load, build and compilation."),
         Column("seconds", "Median over seeds; inf where the median seed did not get there.", "estimate"),
         Column("reached", "Seeds that reached the target.", "count"),
         Column("at_first", "Of these, how many were there at their first checkpoint (an upper bound).", "count"),
         Column("seeds", "Seeds that were run.", "count")],
    )  # fmt: skip
    metric = analysis.results.metric
    for verdict in analysis.verdicts:
        who = _cell(verdict.contender.done[0])
        for start, times in (("warm", verdict.warm), ("cold", verdict.cold)):
            for target, time in zip(analysis.results.targets, times, strict=True):
                table.rows.append({
                    **who, "metric": metric, "target": target, "start": start,
                    "seconds": (time.median, time.low, time.high), "reached": time.reached,
                    "at_first": time.at_first, "seeds": time.seeds,
                })  # fmt: skip
    return table


def phase_rows(results: Results) -> Table:
    """One row a cell, whatever became of it."""
    counters = list(dict.fromkeys(key for cell in results.cells for key in cell.get("counters") or {}))
    machine = list(dict.fromkeys(key for cell in results.cells for key in cell.get("machine") or {}))
    columns = [
        *CELL, Column("state", "done, failed, timeout or skipped."),
        Column("order", "Position of the cell in the run.", "count"),
        *(Column(f"{phase}_seconds", f"Seconds of the phase {phase}.", "number") for phase in PHASES),
        *(Column(f"counter_{name}", f"The engine's counter {name}.", "number") for name in counters),
        *(Column(f"machine_{name}", f"The machine during the cell: {name}.") for name in machine),
        Column("sentinel_seconds", "Seconds of the fixed sentinel kernel beside the cell.", "number"),
        Column("message", "Why it has no result."),
    ]  # fmt: skip
    table = Table("phases", "Phases", "One row a cell.", columns)
    for cell in results.cells:
        row = _cell(cell) | {f"{phase}_seconds": (cell.get("phases") or {}).get(f"{phase}_seconds") for phase in PHASES}
        row |= {f"counter_{name}": value for name, value in (cell.get("counters") or {}).items()}
        row |= {f"machine_{name}": value for name, value in (cell.get("machine") or {}).items()}
        row |= {"sentinel_seconds": cell.get("sentinel_seconds"), "message": cell.get("message")}
        table.rows.append(row)
    return table


def metric_meaning(name: str) -> str:
    """The sentence for a metric column: `relmse_e0.01_se` is looked up as `relmse_se`."""
    base, _, rest = name.partition("_e")
    if rest[:1].isdigit():
        _, _, suffix = rest.partition("_")
        return METRIC_MEANINGS.get(f"{base}_{suffix}" if suffix else base, name)
    return METRIC_MEANINGS.get("mean" if name.startswith("mean_") else name, name)


def _cell(cell: Event) -> dict[str, Any]:
    settings = settings_of(cell)._asdict()
    plain = ("cell_id", "env_id", "engine_version", "width", "height", "block", "seed", "state", "order")
    return {**settings, **{key: cell.get(key) for key in plain}}
