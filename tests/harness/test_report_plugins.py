"""Plots and tables of one's own: found by name, given the DataFrame that they name, and never in the way of the rest."""

import shutil
from importlib.metadata import EntryPoint

import pandas as pd
import pytest
from matplotlib.figure import Figure

from engines.errors import ConfigError, UnknownName
from harness.analysis import analyse
from harness.analysis.frames import open_results
from harness.report import plugins, write_derived
from harness.report.plugins import Plugin, plugin
from harness.store.results import load_results
from tests.harness.sweeping import raybench

MODULE = """
from matplotlib.figure import Figure

def seconds(points):
    '''Seconds over samples & more.'''
    figure = Figure()
    figure.subplots().plot(points.spp, points.seconds, "o")
    return figure

def states(cells):
    return cells.groupby(["scene", "state"]).seed.agg(["count", "mean"])

def failing(points):
    raise ValueError("first line\\nsecond <line>")

def leaving(cells):
    raise SystemExit("gone")

def wrong(points):
    return points

def nameless(frame): ...
def many(points, cells): ...
constant = 3
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    name = f"report_of_{tmp_path.name}"  # an imported module keeps its name
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    return name


@pytest.fixture
def folder(reported, tmp_path):
    derived = shutil.ignore_patterns("plots", "tables", "*.csv", "report.html", "images")
    return shutil.copytree(reported, tmp_path / "copy", ignore=derived)


def test_they_are_written_and_shown_and_what_fails_is_a_line_and_nothing_else(own, folder, capsys, with_plots):
    names = [("plot", "seconds"), ("table", "states"), ("plot", "failing"), ("table", "leaving"), ("plot", "wrong")]
    page = write_derived(folder, [plugin(kind, f"{own}:{name}") for kind, name in names]).read_text()
    assert (folder / "plots" / "own-seconds.svg").exists() and not list((folder / "plots").glob("own-[!s]*"))
    assert 'id="plot-own-seconds"' in page and "<figcaption>Seconds over samples &amp; more.</figcaption>" in page
    assert 'src="data:image/svg+xml;base64,' in page
    frame = pd.read_csv(folder / "tables" / "own-states.csv")
    assert list(frame.columns) == ["scene", "state", "count", "mean"] and "done" in set(frame.state)
    assert 'id="table-own-states"' in page and 'id="table-time_to_quality"' in page
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"plot '{own}:failing' is left out: ValueError: first line",
        f"table '{own}:leaving' is left out: SystemExit: gone",
        f"plot '{own}:wrong' is left out: TypeError: expected a Matplotlib figure, found DataFrame",
    ]
    assert page.count('role="alert">plot &#39;') == 2 and page.count('role="alert">table &#39;') == 1


def test_a_table_of_the_ratios_along_axes_gets_the_frame_that_users_open(own, folder):
    seen = []

    def engines(by_axis):
        """Ratios of engines."""
        seen.append(by_axis)
        return by_axis[by_axis.axis == "engine"]

    made = plugins.make([Plugin("table", "engines", "by_axis", engines)], analyse(load_results(folder)), folder)
    pd.testing.assert_frame_equal(seen[0], open_results(folder).by_axis)
    assert not made.problems and made.tables[0].rows and {row["axis"] for row in made.tables[0].rows} == {"engine"}


def test_the_next_report_without_them_has_none(own, folder, with_plots):
    write_derived(folder, [plugin("table", f"{own}:states"), plugin("plot", f"{own}:seconds")])
    assert {path.stem for path in folder.rglob("own-*")} == {"own-states", "own-seconds"}
    page = write_derived(folder).read_text()
    assert not list(folder.rglob("own-*")) and "own-s" not in page


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nameless", r"its parameters are \(frame\): expected one, named points, cells, times_to_quality, verdicts, by_axis"),
        ("many", r"its parameters are \(points, cells\): expected one"),
        ("constant", "is no function"),
        ("missing", "cannot be imported: .*missing"),
    ],
)
def test_what_is_no_function_of_a_dataframe_is_refused(own, name, message):
    with pytest.raises(ConfigError, match=message):
        plugin("plot", f"{own}:{name}")


def test_a_registered_name_is_found_and_another_is_refused_with_the_nearest(own, monkeypatch):
    point = EntryPoint("seconds", f"{own}:seconds", "raybench.plots")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point] if group == "raybench.plots" else [])
    found = plugin("plot", "seconds")
    assert (found.frame, found.stem, found.title) == ("points", "own-seconds", "seconds")
    with pytest.raises(UnknownName, match=r"unknown plot 'second': .*'seconds'"):
        plugin("plot", "second")
    with pytest.raises(UnknownName, match="unknown table 'seconds'"):
        plugin("table", "seconds")


def test_a_registered_name_whose_module_fails_says_so(monkeypatch):
    point = EntryPoint("broken", "no_such_module_here:plot", "raybench.plots")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    with pytest.raises(ConfigError, match=r"plot 'broken' \(no_such_module_here:plot\): cannot be loaded: .*no_such_module"):
        plugin("plot", "broken")


def test_a_plugin_cannot_change_what_the_next_one_gets(folder):
    seen = []

    def spoil(points):
        seen.append(points.spp.sum())
        points["spp"] = 0
        return Figure()

    again = [Plugin("plot", name, "points", spoil) for name in ("mine:first", "mine:second")]
    write_derived(folder, again)
    assert seen[0] == seen[1] > 0


def test_the_command_asks_for_leave_and_writes_nothing_before(own, folder, tmp_path):
    refused = raybench("report", folder, "--plot", f"{own}:seconds", cwd=tmp_path)
    assert refused.returncode == 2 and "run with --allow-imports" in refused.stderr and not (folder / "report.html").exists()
    chapter = raybench("report", folder, "--chapter", tmp_path / "c", "--table", "x", cwd=tmp_path)
    assert chapter.returncode == 2 and "--table x: is for a report" in chapter.stderr
