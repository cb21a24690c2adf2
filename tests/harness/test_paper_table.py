"""`raybench table`: each cell is the value of one contestant, and what is ambiguous or missing is said in a line."""

import shutil
import subprocess

import pytest

from engines.errors import ConfigError, RaybenchError
from harness.analysis import analyse
from harness.report.moments import moment_of
from harness.report.paper_table import FORMATS, Asked, conditions, paper_table
from harness.statistics import geometric_interval
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.synthetic import write_folder
from tests.harness.test_races import contestant, results

RANDOM = {"sampler": "random", "target": "0.01"}
ONE_A_CELL = Asked("seconds", "scene", "engine", RANDOM)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("paper") / "results", seeds=3, threads=(1,), with_images=False)


@pytest.fixture(scope="module")
def analysis(folder):
    return analyse(load_results(folder))


def contestant_of(analysis, scene, engine, sampler):
    return next(
        c
        for c in analysis.results.contestants
        if (c.settings.scene, c.settings.engine, c.settings.sampler.name) == (scene, engine, sampler)
        and c.done
        and not c.settings.label
    )


def test_a_cell_has_the_seconds_and_the_ratio_of_its_contestant(analysis):
    for value in ("seconds", "ratio"):
        found = paper_table(analysis, ONE_A_CELL._replace(value=value))
        assert [row["scene"] for row in found.rows] == ["cornell_box", "two_spheres"]
        for row in found.rows:
            expected = analysis.at(contestant_of(analysis, row["scene"], "embree", "random"), 0.01)
            assert row["embree"][0] == pytest.approx(getattr(expected, value), nan_ok=True)
            assert row["embree"][1] == pytest.approx(getattr(expected, f"{value}_low"), nan_ok=True)


def test_error_and_seconds_at_a_moment_are_those_of_its_checkpoints(analysis):
    for value, of in (("error", lambda p: p.metrics["relmse_e0.01_corrected"]), ("seconds", lambda p: p.seconds)):
        asked = Asked(value, "engine", "sampler", {"scene": "cornell_box"}, moment_of("64spp"))
        row = next(row for row in paper_table(analysis, asked).rows if row["engine"] == "numba")
        cells = contestant_of(analysis, "cornell_box", "numba", "sobol").done
        expected = geometric_interval([of(next(p for p in cell.points if p.spp == 64)) for cell in cells])
        assert row["sobol"] == pytest.approx(expected)


def test_samples_to_a_target_are_its_seconds_over_seconds_per_sample(analysis):
    asked = Asked("spp", "engine", "target", {"scene": "cornell_box", "sampler": "random"})
    row = next(row for row in paper_table(analysis, asked).rows if row["engine"] == "embree")
    contestant = contestant_of(analysis, "cornell_box", "embree", "random")
    per_sample = geometric_interval([cell.end.seconds / cell.end.spp for cell in contestant.done]).value
    assert row["0.01"][0] == pytest.approx(analysis.at(contestant, 0.01).seconds / per_sample, rel=1e-6)


def test_options_and_targets_are_settings_in_the_order_of_their_numbers(analysis):
    found = paper_table(
        analysis, Asked("seconds", "max_depth", "target", {"scene": "cornell_box", "engine": "numba", "sampler": "random"})
    )
    assert [column.name for column in found.columns] == ["max_depth", "0.001", "0.01", "0.1"]
    assert [row["max_depth"] for row in found.rows] == ["6"]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (
            ONE_A_CELL._replace(where={"target": "0.01"}),
            "differ in sampler: random, sobol: choose one, as --where 'sampler=random'",
        ),
        (ONE_A_CELL._replace(where={"sampler": "sobol"}), "differ in target: 0.1, 0.01, 0.001: choose one, as --target 0.001"),
        (ONE_A_CELL._replace(where={"sampler": "halton"}), "--where sampler=halton: sampler is random or sobol"),
        (ONE_A_CELL._replace(rows="colour"), "unknown setting 'colour'"),
        (ONE_A_CELL._replace(rows="engine"), "rows and columns are both engine"),
        (ONE_A_CELL._replace(value="ratio", moment=moment_of("2s")), "--target is expected"),
        (ONE_A_CELL._replace(value="error"), "depends on no target"),
    ],
)
def test_what_is_ambiguous_or_unknown_is_one_line_that_says_what_to_do(analysis, asked, words):
    with pytest.raises(RaybenchError) as caught:
        paper_table(analysis, asked)
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("texts", [["sampler"], ["=sobol"], ["a=1", "a=2"]])
def test_conditions_are_settings_with_one_value(texts):
    with pytest.raises(ConfigError, match="--where"):
        conditions(texts, None)


def test_the_note_names_baseline_units_and_epsilon_and_why_a_value_is_missing(analysis):
    note = paper_table(analysis, ONE_A_CELL._replace(value="ratio", where=RANDOM | {"scene": "cornell_box"})).note
    assert "relMSE (ε = 0.01) is 0.01" in note and "Baseline: numpy" in note
    assert "mitsuba random 2 threads on cornell_box: not measured (failed)" in note
    assert "A/A" not in note and "Not measured" not in note


@pytest.mark.parametrize(
    ("value", "moment", "why"),
    [
        ("ratio", None, "only bounds are known: of some block that both have each did not reach the target"),
        ("error", moment_of("64spp"), "errors of 1 of 5 seeds are below 0: they are smaller than the noise of the reference"),
        ("error", moment_of("4096spp"), "no checkpoint at 4096 spp in 5 of 5 seeds"),
    ],
)
def test_each_cell_without_a_value_has_a_mark_and_its_reason_as_tooltip_and_in_the_note(tmp_path, value, moment, why):
    def below(cell):
        if cell["block"] == 2:
            for point in cell["points"]:
                point["metrics"]["relmse_e0.01_corrected"] = -1e-9

    def unreached(cell):
        cell["points"] = cell["points"][:4]

    change = below if moment else unreached
    found = analyse(results(tmp_path, contestant(0.01, change=change), contestant(0.02, sampler="sobol", change=change)))
    where = {"sampler": "sobol"} | ({} if moment else {"target": "0.01"})
    table = paper_table(found, Asked(value, "scene", "sampler", where, moment))
    assert why in table.note and FORMATS["markdown"](table).splitlines()[2] == "| hall | – |"
    assert f'<td title="{why}' in FORMATS["html"](table)


def test_the_note_names_the_cells_that_nothing_measured(analysis):
    asked = ONE_A_CELL._replace(rows="engine", columns="contestant", where=RANDOM | {"scene": "cornell_box"})
    note = paper_table(analysis, asked).note
    numpy, embree = (contestant_of(analysis, "cornell_box", engine, "random").name for engine in ("numpy", "embree"))
    assert "Not measured: " in note and f"numpy with {embree}" in note and f"numpy with {numpy}" not in note


def test_latex_is_a_tabular_that_compiles_without_packages(analysis, tmp_path):
    text = FORMATS["latex"](paper_table(analysis, ONE_A_CELL))
    head, *lines = text.splitlines()
    assert head.startswith("% ") and lines[0] == "\\begin{tabular}{lrrrr}" and lines[-1] == "\\end{tabular}"
    assert all(line.count(" & ") == 4 for line in lines if line.endswith("\\\\"))
    latex = shutil.which("pdflatex")
    if latex:
        (tmp_path / "t.tex").write_text(f"\\documentclass{{article}}\\begin{{document}}\n{text}\\end{{document}}\n")
        done = subprocess.run(
            [latex, "-interaction=batchmode", "-halt-on-error", "t.tex"], check=False, cwd=tmp_path, capture_output=True
        )
        assert done.returncode == 0, (tmp_path / "t.log").read_text()[-2000:]


def test_the_command_writes_each_format_and_refuses_others(folder, tmp_path):
    asked = ["--value", "seconds", "--columns", "engine", "--where", "sampler=random", "--target", "0.01"]
    for name, starts in (
        ("t.tex", "% Seconds"),
        ("t.md", "| scene |"),
        ("t.csv", "scene,embree,embree_low"),
        ("t.html", "<table>"),
    ):
        done = sweeping.raybench("table", folder, *asked, "-o", tmp_path / name)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / name).read_text().startswith(starts)
    done = sweeping.raybench("table", folder, *asked, "-o", tmp_path / "t.docx")
    assert done.returncode == 2 and "must end in .tex, .md, .csv or .html" in done.stderr
