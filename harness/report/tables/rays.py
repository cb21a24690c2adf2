"""The table of contestants that trace rays: rates, ratios, wrong answers, leaks."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.analysis.columns import Column, Table
from harness.analysis.rays import RayContestant, ray_races
from harness.report.tables.evidence import spreads_text
from harness.statistics import Estimate, geometric_interval
from harness.store.results import Results, phase_seconds

COLUMNS = [
    Column("scene", "Scene."),
    Column("primitives", "Triangles, spheres and other shapes of the scene.", "count"),
    Column("rays", "Set of rays: camera, shadow or incoherent."),
    Column("engine", "Engine; twin: the A/A twin of another."),
    Column("version", "Version of the engine."),
    Column("accelerator", "Accelerator."),
    Column("precision", "Precision setting; empty: the engine's own."),
    Column("threads", "Threads of the engine.", "count"),
    Column("machine", "Beginning of the environment's id, in results of several machines."),
    Column("mrays_per_second", "Million rays per second of wall time: geometric mean over blocks.", "estimate", "Mrays/s"),
    Column(
        "mrays_per_cpu_second", "Million rays per second of processor time, of all threads together.", "estimate", "Mrays/cpu s"
    ),
    Column("ratio", "Rate over that of the baseline, paired by blocks; above 1 is faster.", "ratio", "over baseline"),
    Column("verdict", "faster, slower, same or unresolved, as in races."),
    Column("checked", "Rays whose answers were compared with exact ones.", "count"),
    Column("wrong", "Hits of another surface, or at another distance.", "count"),
    Column("missed", "Misses where something is hit.", "count"),
    Column("false_hits", "Hits reported where the ray meets nothing.", "count"),
    Column("error_rate", "Share of answers that are wrong in any way, with its exact interval.", "estimate"),
    Column("hard", "Rays aimed at edges and vertices that triangles share.", "count", "hard rays"),
    Column("leaks", "Hard rays that went through.", "count"),
    Column("leak_rate", "Share of hard rays that went through, with its exact interval.", "estimate"),
    Column("t_median", "Median relative error of the distance of right hits.", "number", "t error: median"),
    Column("t_p999", "The 99.9 % quantile of that error.", "number", "t error: 99.9 %"),
    Column("t_worst", "The largest of these errors.", "number", "t error: worst"),
    Column("build_seconds", "Seconds to build tracer and accelerator: median over blocks.", "number", "build [s]"),
    Column("first_call_seconds", "Seconds of the first call, which may compile: median.", "number", "first call [s]"),
    Column("blocks", "Blocks measured.", "count"),
    Column("contended", "Blocks that were disturbed by other work of the machine, of those of which that is known.", "count"),
    Column("unstable", "Whether answers differed between blocks.", "flag"),
    Column("state", "done, failed, timeout or skipped."),
    Column("message", "Why it was skipped or has failed."),
]


def rays(results: Results) -> Table:
    """A row a contestant, race after race."""
    note = (
        "Wrong answers are counted against exact ones, in decimals of 80 digits. 95 % intervals; of 0 errors the end of an "
        "interval is the bound below which the rate lies with 95 % confidence."
    )
    several = len({cell.env_id for cell in results.ray_cells}) > 1
    found = [one for group in ray_races(results) for one in group]
    compared = {one.settings.machine: one.spread for one in found if one.ratio is not None}
    rows = [_row(one, several) for one in found]
    return Table("rays", "Rays per second and wrong answers", f"{note} {spreads_text(compared)}".rstrip(), COLUMNS, rows)


def _row(one: RayContestant, several_machines: bool) -> dict[str, Any]:
    settings, cell, answers = one.settings, one.told_by, one.answers
    row: dict[str, Any] = {
        "scene": settings.scene,
        "primitives": cell.primitives,
        "rays": settings.rays,
        "engine": f"{settings.engine} ({settings.label.replace('A/A', 'twin')})" if settings.label else settings.engine,
        "version": cell.engine_version,
        "accelerator": one.accelerator,
        "precision": settings.precision,
        "threads": settings.threads,
        "machine": settings.machine if several_machines else None,
        "verdict": "baseline" if one.baseline else one.ratio.verdict if one.ratio else "",
        "ratio": Estimate(*one.ratio[:4]) if one.ratio else None,
        "unstable": one.unstable,
        "state": cell.state,
        "message": cell.message,
    }
    if one.done:
        row |= {
            "mrays_per_second": geometric_interval(one.rates()),
            "mrays_per_cpu_second": geometric_interval(one.rates(cpu=True)),
            "build_seconds": float(np.median([phase_seconds(each, "build") for each in one.done])),
            "first_call_seconds": float(np.median([phase_seconds(each, "compile") for each in one.done])),
            "blocks": len(one.done),
            "contended": sum(one.judged) if one.judged else None,
        }
    if answers:
        row |= {key: value for key, value in answers.model_dump(exclude={"sha256"}).items() if value is not None}
        row |= {"error_rate": one.error_rate, "leak_rate": one.leak_rate}
    return row
