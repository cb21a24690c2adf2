"""Everything that can be derived from a results folder: tidy csv files, tables, plots and the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.analysis import Analysis, analyse
from harness.console import consoles
from harness.report.plots import write_plots
from harness.report.plugins import Plugin, make
from harness.report.rays_text import rays_text
from harness.report.sentences import sentences_text
from harness.report.tables import write_tables
from harness.report.winners import winners_text
from harness.store import SENTENCES, WINNERS
from harness.store.atomic import write_text
from harness.store.results import load_results


def write_derived(folder: str | Path, plugins: Sequence[Plugin] = (), analysis: Analysis | None = None) -> Path:
    """(Re)writes points.csv, ttq.csv, phases.csv, winners.txt, sentences.txt, tables/, plots/ and report.html; returns the
    report's path.

    Needs manifest, events and images alone, whatever is missing among them. Raises ConfigError without events. What one of the
    `plugins` raises is a line in the report and on stderr. `analysis` is that of the folder where it is known.
    """
    from harness.report.html.assembly import report_html

    analysis = analysis or analyse(load_results(folder))
    results = analysis.results
    tables = write_tables(analysis, results.folder)
    plots = write_plots(analysis, results.folder)
    write_text(results.folder / WINNERS, winners_text(analysis) + rays_text(results))
    write_text(results.folder / SENTENCES, sentences_text(analysis))
    made = make(plugins, analysis, results.folder)
    for problem in made.problems:
        consoles()[1].print(problem, soft_wrap=True, markup=False)
    path = results.folder / "report.html"
    write_text(path, report_html(analysis, [*tables, *made.tables], [*plots, *made.pictures], made.problems))
    return path


def answer_text(analysis: Analysis) -> str:
    """What a run ends with: the fastest to each target, a sentence for each axis, and rays."""
    return winners_text(analysis) + sentences_text(analysis) + rays_text(analysis.results)
