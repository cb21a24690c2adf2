"""The columns of every table of a results folder, from the tables themselves as they are before any row is in."""

from pathlib import Path

from docs._ext.markdown import code, paragraphs, plain, table
from harness.analysis import analyse, frames, measurements
from harness.analysis.columns import ESTIMATES
from harness.metrics import METRIC_MEANINGS
from harness.report.tables import all_tables, changes, history
from harness.report.tables.accelerators import accelerators
from harness.report.tables.deviations import deviations
from harness.report.tables.equivalence import accuracy
from harness.report.tables.rays import rays
from harness.report.tables.scaling import scaling
from harness.store.records import Manifest
from harness.store.results import results_of
from harness.store.validation import FORMAT_VERSION

KINDS = {
    "text": "text",
    "flag": "true or false",
    "number": "number",
    "exact": "number",
    "count": "whole number",
    "percent": "share",
}


def text() -> str:
    config = {"raybench_experiment": 1, "include": [], "revision": "NAME"}
    empty = results_of(Path("results/NAME"), Manifest(raybench_results=FORMAT_VERSION, config=config), [])
    analysis = analyse(empty)
    people = [
        *all_tables(analysis),
        deviations(analysis),
        accelerators(analysis),
        scaling(analysis),
        accuracy(analysis),
        rays(empty),
        changes([empty], [empty]),
        history([empty]),
    ]
    parts = ["## DataFrames"]
    parts += [_section("points", measurements.points(empty)), _section("times_to_quality", frames.times_to_quality(analysis))]
    parts += [_section("cells", measurements.cells(empty)), _section("verdicts", frames.verdicts(analysis))]
    parts += [_section("by_axis", frames.by_axis(analysis))]
    parts += ["### Metrics", "Columns of `points`; `_eNUMBER` in a name is the metric's epsilon."]
    parts += [table(("Column", "Meaning"), [(code(key), plain(value)) for key, value in METRIC_MEANINGS.items()])]
    parts += ["## For people", "Each as `.csv`, `.md` and `.tex` in `tables/`."]
    parts += [_section(each.name, each) for each in people]
    return paragraphs(parts)


def _section(name: str, found) -> str:
    rows = [
        (code(column.name), plain(column.meaning), "estimate" if column.kind in ESTIMATES else KINDS[column.kind])
        for column in found.columns
    ]
    return f"### {name}\n\n{plain(found.note)}\n\n{table(('Column', 'Meaning', 'Kind'), rows)}"
