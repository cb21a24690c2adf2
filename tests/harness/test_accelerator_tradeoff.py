"""Accelerators: what a build costs and saves is found where it is planted, in table and plot."""

import numpy as np
import pytest

from harness.analysis import analyse
from harness.report.plots import Palette
from harness.report.plots.accelerator_tradeoff import build_against_traverse
from harness.report.plots.figures import figure
from harness.report.tables import all_tables, cell_text
from harness.store.results import results_of
from tests.harness.synthetic import SMALL, arranged, done_cell

BUILD = {"none": 0.0, "grid": 0.5, "bvh": 2.0, "bad": 1.0}
SECONDS_PER_SPP = {"none": 0.1, "grid": 0.05, "bvh": 0.02, "bad": 0.2}


@pytest.fixture(scope="module")
def analysis(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("builds"), np.random.default_rng(1)
    cells = []
    for name, label in [*((name, None) for name in BUILD), ("grid", "A/A")]:
        for block in range(5):
            cell = done_cell(folder, ("cornell_box", "numba", name, "random", 1, label), block, 1.0, SMALL, rng, False)
            drift = rng.lognormal(0, 0.3)
            for point in cell["points"]:
                point["seconds"] = SECONDS_PER_SPP[name] * point["spp"] * (1 + 0.1 * block)
            cell["phases"]["build_seconds"] = BUILD[name] * drift
            cells.append(cell)
    return analyse(arranged(folder, cells))


def test_each_is_judged_beside_the_quickest_build_and_breaks_even_when_it_should(analysis):
    table = next(table for table in all_tables(analysis) if table.name == "accelerators")
    rows = {row["contestant"].removeprefix("numba "): row for row in table.rows}
    assert next(iter(rows)) == "brute force" and rows["brute force"]["speedup"] is None and not rows["brute force"]["baseline"]
    for name in ("grid", "bvh"):
        row = rows[name]
        assert row["baseline"] == "brute force" and row["verdict"] == "faster"
        assert row["speedup"].value == pytest.approx(SECONDS_PER_SPP["none"] / SECONDS_PER_SPP[name])
        truth = BUILD[name] / (SECONDS_PER_SPP["none"] - SECONDS_PER_SPP[name])
        assert row["break_even_spp"].low <= truth * 1.5 and row["break_even_spp"].high >= truth / 1.5
    assert rows["bad"]["verdict"] == "slower" and np.isinf(rows["bad"]["break_even_spp"].value)
    column = next(column for column in table.columns if column.name == "break_even_spp")
    assert cell_text(column, rows["bad"]["break_even_spp"]) == "never" and cell_text(column, None) == "–"


def test_the_plot_has_a_point_an_accelerator(analysis):
    chart = build_against_traverse(analysis, Palette(analysis.results))
    assert chart is not None
    labels = figure(chart).legends[0].get_texts()
    assert {text.get_text() for text in labels} == {f"numba {name}".replace("none", "brute force") for name in BUILD}


def test_one_accelerator_alone_has_neither(analysis):
    cells = [cell for cell in analysis.results.cells if cell.accelerator.name == "bvh"]
    alone = analyse(results_of(analysis.results.folder, analysis.results.manifest, cells))
    assert "accelerators" not in {table.name for table in all_tables(alone)}
    assert build_against_traverse(alone, Palette(alone.results)) is None
