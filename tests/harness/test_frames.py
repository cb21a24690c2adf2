"""Results as DataFrames: what they hold is what was measured, documented column by column; the csv files hold the same."""

import io
import json
import math
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import harness
from engines.errors import ConfigError
from harness import store
from harness.analysis.columns import Column, Table, rows_of
from harness.analysis.model import FLAGS
from harness.report.tables import write_tables
from harness.statistics import Estimate
from tests.harness.synthetic import SCENES, SECONDS_PER_SPP, TARGETS, write_folder

NAMES = ("points", "times_to_quality", "cells", "verdicts")
FILES = {"points": "points.csv", "times_to_quality": "ttq.csv", "cells": "phases.csv"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("frames"), seeds=3)


@pytest.fixture(scope="module")
def opened(folder):
    return harness.open_results(folder)


@pytest.fixture(scope="module")
def events(folder):
    return list(store.latest_cells(store.read_events(folder)).values())


def test_points_are_the_checkpoints_of_the_events(opened, events):
    points = opened.points.set_index(["cell_id", "spp"])
    assert len(points) == sum(len(cell.points) for cell in events) and points.index.is_unique
    for cell in events:
        for point in cell.points:
            row = points.loc[(cell.cell_id, point.spp)]
            assert row.seconds == point.seconds and row.rays == point.rays and row.block == cell.block
            assert row["relmse_e0.01"] == point.metrics["relmse_e0.01"]
            assert (row.error, row.error_se) == (point.metrics["relmse_e0.01_corrected"], point.metrics["relmse_e0.01_se"])
            assert row.mean_spp == point.spp and pd.isna(row.film_variance) and not row.separate_renders
            start = sum(getattr(cell.phases, f"{phase}_seconds") for phase in ("import", "load", "build", "compile"))
            assert row.cold_seconds == pytest.approx(start + point.seconds, rel=1e-12)
            assert row.image == point.image or (pd.isna(row.image) and point.image is None)


def test_cells_are_those_of_the_events_whatever_became_of_them(opened, events):
    cells = opened.cells.set_index("cell_id")
    assert list(cells.index) == [cell.cell_id for cell in events]
    assert set(cells.state) == {"done", "failed", "timeout", "skipped"}
    for cell in events:
        row = cells.loc[cell.cell_id]
        assert (row.engine, row.state, row.message, row.threads) == tuple(
            getattr(cell, key) for key in ("engine", "state", "message", "threads")
        )
        assert (row.reference_id, row.reference_shader) == (cell.reference_id, str(cell.shader))
        assert (row.smooth_sampler, row.reproducible, row.primitives) == ("random" in cell.cell_id, True, 0)
        found = cell.phases.render_seconds
        assert row.render_seconds == found or (found is None and math.isnan(row.render_seconds))


def test_rows_of_a_contestant_are_found_in_every_frame(opened):
    """A contestant's cells differ in block and seed alone."""
    keys = ["scene", "contestant"]
    asked = ["engine", "accelerator", "shader", "sampler", "precision", "threads", "label"]
    assert (opened.cells.groupby(keys)[asked].nunique() == 1).all(axis=None)
    everyone = set(opened.cells[keys].itertuples(index=False))
    for name in ("points", "times_to_quality", "verdicts"):
        assert set(getattr(opened, name)[keys].itertuples(index=False)) <= everyone


def test_times_and_ratios_are_those_of_the_power_law(opened):
    """relMSE = level / spp, so 0.1 from level 0.5 takes 5 samples; numpy takes 20 times as long for a sample."""
    verdicts = opened.verdicts.set_index(["scene", "contestant", "target"])
    row = verdicts.loc[("cornell_box", "numba random 1 thread", 0.1)]
    assert row.seconds == pytest.approx(SCENES["cornell_box"] / 0.1 * SECONDS_PER_SPP["numba"], rel=0.15)
    assert row.seconds_low <= row.seconds <= row.seconds_high < row.cold_seconds
    assert row.baseline == "numpy random 1 thread" and row.verdict == "faster" and (row.reached, row.seeds) == (3, 3)
    assert row.ratio == pytest.approx(SECONDS_PER_SPP["numpy"] / SECONDS_PER_SPP["numba"], rel=0.2)
    assert row.ratio_low < row.ratio < row.ratio_high
    assert len(verdicts) == len(opened.analysis.verdicts) * len(TARGETS) and verdicts.index.is_unique


def test_a_verdict_and_the_times_to_quality_say_the_same(opened):
    keys = ["scene", "contestant", "target"]
    for start, column in (("warm", "seconds"), ("cold", "cold_seconds")):
        times = opened.times_to_quality[opened.times_to_quality.start == start]
        both = opened.verdicts.merge(times, on=keys, suffixes=("", "_of_times"), validate="one_to_one")
        assert len(both) == len(opened.verdicts)
        np.testing.assert_array_equal(both[column], both["seconds_of_times"])


def test_the_baseline_has_no_verdict_and_an_unreached_target_no_winner(opened):
    verdicts = opened.verdicts
    own = verdicts[verdicts.baseline.isna()]
    assert set(own.engine) == {"numpy"} and (own.verdict == "").all() and own.ratio.isna().all()
    unreached = verdicts[verdicts.reached == 0]
    assert len(unreached) and not unreached.possible_winner.any(), "others had it long before these gave up"
    reached = verdicts[np.isfinite(verdicts.seconds) & (verdicts.label == "") & ~verdicts["flags"].str.contains("biased")]
    best = reached.loc[reached.groupby(["scene", "target"]).seconds.idxmin()]
    assert best.possible_winner.all(), "the fastest is a possible winner"
    surely_slower = reached.merge(best, on=["scene", "target"], suffixes=("", "_of_best"))
    surely_slower = surely_slower[surely_slower.seconds_low > 1.5 * surely_slower.seconds_high_of_best]
    assert len(surely_slower) and not surely_slower.possible_winner.any()


def test_flags_are_documented_names(opened):
    verdicts = opened.verdicts
    assert {flag for flags in verdicts["flags"] for flag in flags.split()} <= FLAGS.keys()
    biased = verdicts[verdicts["flags"].str.contains("biased")]
    assert set(biased.engine) == {"embree"} and set(biased.scene) == {"two_spheres"}
    assert all(f"{name}: " in opened.columns("verdicts")["flags"] for name in FLAGS)


@pytest.mark.parametrize("name", NAMES)
def test_every_column_is_documented(opened, name):
    meanings = opened.columns(name)
    assert list(meanings) == list(getattr(opened, name).columns)
    assert all(len(meaning) > 5 for meaning in meanings.values())
    assert set(map(str, getattr(opened, name).dtypes)) <= {"string", "boolean", "Int64", "float64"}


@pytest.mark.parametrize("name", FILES)
def test_the_csv_files_hold_the_frames(opened, name, tmp_path):
    """Without the contestant's name; numbers are the same to the last bit."""
    write_tables(opened.analysis, tmp_path)
    frame = getattr(opened, name).drop(columns="contestant")
    text = (tmp_path / FILES[name]).read_text()
    read = pd.read_csv(io.StringIO(text), dtype=frame.dtypes.to_dict(), keep_default_na=False, na_values=[""])
    expected = frame.apply(lambda column: column.replace("", pd.NA) if column.dtype == "string" else column)
    pd.testing.assert_frame_equal(read, expected, check_exact=True)


def test_a_frame_gives_back_the_rows_it_was_made_of():
    columns = [
        Column("who", "x"),
        Column("n", "x", "count"),
        Column("s", "x", "estimate"),
        Column("v", "x", "number"),
        Column("ok", "x", "flag"),
    ]
    rows = [
        {"who": "a", "n": 2**60 + 1, "s": Estimate(1.0, 0.5, math.inf, 0), "v": 1e-300, "ok": True},
        {"who": None, "n": None, "s": Estimate(math.inf, 2.0, math.inf, 0), "v": None, "ok": False},
    ]
    frame = Table("t", "t", "", columns, rows).frame
    assert list(frame.columns) == ["who", "n", "s", "s_low", "s_high", "v", "ok"]
    assert rows_of(frame, columns) == rows
    empty = Table("t", "t", "", columns).frame
    assert empty.empty and (empty.dtypes == frame.dtypes).all() and rows_of(empty, columns) == []


def test_an_event_may_name_a_metric_as_it_likes(tmp_path):
    """Names of metrics and counters come from a file: none takes the place of a column."""
    folder = write_folder(tmp_path / "odd", seeds=2, with_images=False)
    lines = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    for event in lines:
        for point in event.get("points", []):
            point["metrics"] |= {"scene": 1.0, "seconds": -1.0}
        if event["event"] == "cell":
            event["phases"] |= {"engine": 2.0}
            event["counters"] |= {"engine": 3.0}
    (folder / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in lines))
    opened = harness.open_results(folder)
    assert (opened.points.seconds > 0).all() and set(opened.points.scene) == set(SCENES)
    assert "2.0" not in set(opened.cells.engine) and set(opened.cells.counter_engine.dropna()) == {3.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda folder: None, "no such folder"),
        (lambda folder: folder.mkdir(), "has no events.jsonl"),
        (lambda folder: damaged(folder, "manifest.json", '{"raybench_results": 99}'), "results of format 99"),
        (lambda folder: damaged(folder, "events.jsonl", "{\n{}\n"), r"events.jsonl:1: not an event"),
        (lambda folder: [folder.mkdir(), (folder / "events.jsonl").touch()], "empty events.jsonl"),
    ],
    ids=["missing", "empty", "another version", "damaged", "no event"],
)
def test_a_folder_that_cannot_be_opened_is_one_clear_line(tmp_path, change, message):
    folder = tmp_path / "results"
    change(folder)
    with pytest.raises(ConfigError, match=message) as error:
        harness.open_results(folder)
    assert "\n" not in str(error.value) and str(folder) in str(error.value)


def damaged(folder, name, text):
    write_folder(folder, seeds=1, with_images=False)
    (folder / name).write_text(text)


def test_a_run_imports_no_pandas():
    script = "import sys, harness.analysis, harness.run.sweep; print('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_importing_the_harness_imports_neither_pandas_nor_numpy():
    script = "import sys, harness; print([m for m in ('numpy', 'pandas', 'harness.analysis') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    with pytest.raises(AttributeError, match="open_result"):
        _ = harness.open_result
