"""Engines compared by the rays that they trace, and by their wrong answers: `raybench race --rays`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from harness.config import ConfigFile
    from harness.run.sweep import Options, Outcome

RAY_KINDS = ("camera", "shadow", "incoherent")
ENGINES = ("numpy", "numba", "embree", "embreex_batch")
"""Those that are compared where none is named."""


def experiment(scenes: list[Any], axes: Mapping[str, list[Any]]) -> dict[str, Any]:
    """The experiment of a comparison by rays."""
    return {
        "raybench_experiment": 1,
        "matrix": {"scene": scenes, **axes},
        "budget": {"max_time": "500ms"},
        "repeats": 5,
        "remeasure": 0,
    }


def measure(file: ConfigFile, out: Path | None, overrides: list[str], fresh: bool, options: Options, json: bool) -> int:
    """Runs a comparison by rays; the exit code, 2 where no cell was measured. `json`: the rows of the table are printed so."""
    from harness import config
    from harness.cli import experiments

    folder = experiments.results_folder(config.load(file, overrides), out)
    summary = _print_rows if json else experiments.print_summary
    return experiments.run(file, folder, overrides, fresh, options, summary) or _declined(folder)


def _print_rows(console: Console, outcome: Outcome, folder: Path) -> None:
    """The table `rays` as JSON, a mapping a row; what failed on stderr."""
    from harness.cli import experiments
    from harness.console import consoles
    from harness.report.tables.rays import rays as table_of
    from harness.store.results import load_results

    text = table_of(load_results(folder)).frame.to_json(orient="records", indent=1, double_precision=15)
    console.print(text, markup=False, soft_wrap=True)
    experiments.print_failures(consoles()[1], outcome, folder)


def _declined(folder: Path) -> int:
    """2 where no cell was measured, else 0."""
    from harness.store.results import load_results

    return 0 if any(cell.state == "done" for cell in load_results(folder).ray_cells) else 2
