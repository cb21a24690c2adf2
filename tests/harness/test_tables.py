"""Tables say what the synthetic folder is known to hold, in every format, and document every column."""

import csv
import io
import json
import math
import re
from dataclasses import replace
from itertools import pairwise

import pytest

from engines.choices import Choice
from engines.schema.yaml_file import locate
from harness.analysis import analyse, baseline_engine_of
from harness.config.filters import CONTESTANTS
from harness.report.tables import all_tables, columns, write_tables
from harness.report.tables.model import (
    Column,
    Table,
    cell_text,
    csv_text,
    estimate_text,
    latex_text,
    markdown_text,
    number_text,
)
from harness.store.results import brief_choice, load_results
from tests.harness.synthetic import COMPILE_SECONDS, SCENES, SECONDS_PER_SPP, write_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("tables"))


@pytest.fixture(scope="module")
def analysis(folder):
    return analyse(load_results(folder))


@pytest.fixture(scope="module")
def tables(analysis, folder):
    return {table.name: table for table in write_tables(analysis, folder)}


def row_of(table, **wanted):
    rows = [row for row in table.rows if all(row[key] == value for key, value in wanted.items())]
    assert len(rows) == 1, (wanted, [row["contestant"] for row in rows])
    return rows[0]


def read_csv(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def test_time_to_quality_is_that_of_the_power_law(tables):
    """relMSE = level / spp, so 0.1 from level 0.5 takes 5 samples of 0.02 s."""
    row = row_of(tables["time_to_quality"], scene="cornell_box", contestant="numba random 1 thread", target=0.1)
    expected = SCENES["cornell_box"] / 0.1 * SECONDS_PER_SPP["numba"]
    assert row["warm_seconds"].value == pytest.approx(expected, rel=0.1)
    start = row["cold_seconds"].value - row["warm_seconds"].value
    assert start == pytest.approx(0.86 + COMPILE_SECONDS["numba"], rel=0.02)
    assert row["reached"] == "5/5" and row["bias"].startswith("mean < ") and row["equivalence"] == "equivalent"


def test_an_unreached_target_is_counted_and_not_extrapolated(tables):
    row = row_of(tables["time_to_quality"], scene="cornell_box", contestant="numpy random 1 thread", target=0.001)
    assert row["reached"] == "0/5" and math.isinf(row["warm_seconds"].value)


def test_the_biased_engine_is_flagged_and_the_others_are_not(tables):
    for row in tables["bias_and_equivalence"].rows:
        if row["scene"] == "two_spheres" and row["contestant"].startswith("embree"):
            assert "flagged" in row["bias"] and row["verdict"] == "different"
            assert row["difference"].value == pytest.approx(0.03, abs=0.005)
        else:
            assert "flagged" not in row["bias"] and row["verdict"] in ("equivalent", "unresolved", "image baseline")


def test_speedups_are_those_of_the_samples(tables):
    who = {"scene": "cornell_box", "contestant": "numba random 1 thread"}
    row = row_of(tables["speedups"], **who, measure="seconds per sample")
    assert row["speedup"].value == pytest.approx(SECONDS_PER_SPP["numpy"] / SECONDS_PER_SPP["numba"], rel=0.05)
    assert row["verdict"] == "faster" and row["baseline"] == "numpy random 1 thread"


def test_threads_show_amdahls_tenth(tables):
    for row in tables["threads"].rows:
        assert row["serial_fraction"].value == pytest.approx(0.1, abs=0.04)
        assert row["threads"] == 1 or row["speedup"].value == pytest.approx(1 / 0.55, rel=0.05)


def test_slopes_are_named(tables):
    for row in tables["convergence"].rows:
        if row["scene"] == "cornell_box":
            assert row["slope_verdict"] == ("steeper" if "sobol" in row["contestant"] else "monte carlo")


def test_slopes_are_of_mean_squares_whatever_the_quality_metric(folder):
    results = load_results(folder)
    results.metric = "mape"
    slopes = {v.contestant.name: v.slope for v in analyse(results).verdicts if v.contestant.settings.scene == "cornell_box"}
    assert slopes["numba random 1 thread"].verdict == "monte carlo"
    assert slopes["numba sobol 1 thread"].value == pytest.approx(-0.7, abs=0.02)


def test_a_quality_that_rises_is_reached_from_below(folder, analysis):
    """The folder's PSNR says an MSE of a fifth of its relMSE."""
    results = load_results(folder)
    results.metric, results.targets = "psnr", [-10 * math.log10(0.2 * target) for target in results.targets]
    found = analyse(results)
    first = analysis.verdicts[0].contestant
    times = [found.at(first, target).seconds for target in found.results.targets]
    assert times[0] == pytest.approx(analysis.at(first, analysis.results.targets[0]).seconds, rel=0.05)
    assert all(a <= b for a, b in pairwise(times))
    words = {table.name: table for table in all_tables(found)}["time_to_quality"].note
    assert "MSE of display values (from PSNR), not corrected for the reference's noise" in words


def test_the_config_may_name_the_baseline(folder):
    results = load_results(folder)
    results = replace(results, config=replace(results.config, baseline=CONTESTANTS.read(locate("embree"))))
    assert baseline_engine_of(results) == "embree"


def test_failures_name_state_reason_and_count(tables):
    found = {(row["contestant"], row["state"], row["cells"]) for row in tables["failures"].rows}
    assert {state for _, state, _ in found} == {"failed", "timeout", "skipped"}
    assert any(state == "skipped" and count == 5 for _, state, count in found)


def test_files_hold_one_row_a_checkpoint_verdict_and_cell(tables, analysis, folder):
    cells = analysis.results.cells
    points, ttq, phases = (read_csv(folder / name) for name in ("points.csv", "ttq.csv", "phases.csv"))
    assert len(points) == sum(len(cell.points) for cell in cells) and len(phases) == len(cells)
    assert len(ttq) == len(analysis.verdicts) * 3 * 2
    assert {"seconds", "cold_seconds", "relmse_e0.01", "relmse_e0.01_corrected"} <= set(points[0])
    unreached = [row for row in ttq if row["reached"] == "0"]
    assert unreached and all(row["seconds"] == "inf" for row in unreached)


def test_every_column_is_documented(tables, folder):
    meanings = columns(list(tables.values()))
    assert all(meaning.endswith((".", ")")) and len(meaning) > 5 for meaning in meanings.values())
    text = (folder / "tables" / "columns.md").read_text()
    for name in ("points.csv", "ttq.csv", "phases.csv"):
        for column in read_csv(folder / name)[0]:
            assert f"`{re.sub('_(low|high)$', '', column)}`" in text, column


def test_every_table_comes_in_three_formats(tables, folder):
    for name, table in tables.items():
        rows = read_csv(folder / "tables" / f"{name}.csv")
        assert len(rows) == len(table.rows)
        markdown = (folder / "tables" / f"{name}.md").read_text()
        assert sum(line.startswith("|") for line in markdown.splitlines()) == len(rows) + 2
        latex = (folder / "tables" / f"{name}.tex").read_text()
        assert latex.count("\\\\\n") == len(rows) + 1 and "\\toprule" in latex and "\\bottomrule" in latex


def test_latex_and_markdown_escape_what_would_break_them():
    table = Table("t", "50 % of $x_1$", "a & b", [Column("a_b", "x")], [{"a_b": "p|q_{r}\nnext & 5 % ∞"}])
    assert all(part in latex_text(table) for part in (r"p|q\_\{r\}", r"5 \% $\infty$", r"a \& b"))
    assert "p\\|q_{r} next" in markdown_text(table)
    assert csv_text(table).splitlines()[0] == "a_b"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0123456, "0.0123"),
        (0.1, "0.100"),
        (12345.6, "12.3k"),
        (4.56e6, "4.56M"),
        (1.2e-5, "1.20e-05"),
        (0.0, "0"),
        (256.0, "256"),
        (math.inf, "∞"),
        (math.nan, "–"),
        (-0.5, "-0.500"),
        (999.99, "1000"),
        (0.09997, "0.100"),
    ],
)
def test_numbers_have_three_digits(value, text):
    assert number_text(value) == text


def test_estimates_show_their_interval_or_why_there_is_none():
    assert estimate_text((1.5, 1.25, 2.125)) == "1.50 [1.25, 2.12]"
    assert estimate_text((math.inf, math.inf, math.inf)) == "not reached"
    assert estimate_text((1.5, 1.25, math.inf)) == "1.50 [1.25, ∞)"
    assert estimate_text((1.5, math.nan, math.nan)) == "1.50" and estimate_text((math.nan,) * 3) == "–"
    assert cell_text(Column("r", "", "ratio"), (math.inf, 31.6, math.inf)) == "> 31.6"
    assert cell_text(Column("r", "", "ratio"), (0.0, 0.0, 0.0)) == "never"
    assert cell_text(Column("r", "", "ratio"), (0.0, 0.0, 0.4)) == "< 0.400"
    assert estimate_text((1.5, 0.0, 2.125)) == "< 2.12" and estimate_text((math.inf, 0.0, math.inf)) == "not reached"


def test_names_say_what_differs_and_no_more(analysis):
    names = {contestant.name for contestant in analysis.results.contestants if contestant.done}
    assert {"numpy sobol 1 thread", "embree random 2 threads", "numba random 1 thread A/A"} <= names
    pair = [Choice("bvh", {"sah": True, "leaf": 4}), Choice("bvh", {"leaf": 8, "sah": True}), Choice("grid")]
    assert [brief_choice(choice, pair) for choice in pair] == ["bvh(leaf=4)", "bvh(leaf=8)", "grid"]
    assert str(pair[0]) == "bvh(leaf=4, sah=True)"


def test_contestants_are_unique_within_a_scene(analysis):
    for scene in analysis.results.scenes:
        names = [c.name for c in analysis.results.contestants if c.settings.scene == scene]
        assert len(names) == len(set(names))


def test_a_folder_without_a_measured_cell_has_empty_tables(tmp_path):
    folder = write_folder(tmp_path / "none", seeds=1, with_images=False)
    lines = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    kept = [event for event in lines if event["event"] != "cell" or event["state"] != "done"]
    (folder / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in kept))
    tables = {table.name: table for table in all_tables(analyse(load_results(folder)))}
    assert tables["time_to_quality"].rows == [] and len(tables["failures"].rows) == 3
