"""`raybench race`: an experiment of one line, its answer, and the same experiment as a file."""

import math

import pytest
import yaml

from harness import config, open_results
from harness.cli import race
from harness.cli.race_output import _share
from harness.plan import planner
from harness.run import reference_samples
from harness.store import reference_files
from tests.harness import sweeping
from tests.needs import needs

TWO = "fake_engines:Steady,fake_engines:Other"
NOTHING_ALLOWED = (False, False, False)
FAST = ("--time", "300ms", "--size", "12x8", "--set", "reference.engine=fake_engines:Steady", "--set", "images=last")


def raced(folder, *words):
    sweeping.write(folder)
    return sweeping.raybench("race", "ball.yaml", *FAST, "--allow-imports", *words, cwd=folder, RAYBENCH_PLOTS="svg")


def test_a_race_says_who_is_sooner_and_keeps_the_experiment_that_it_ran(tmp_path):
    done = raced(tmp_path, "--engine", TWO, "--to", "0.1,0.03", "--repeats", "3", "--save", "race.yaml", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert done.stdout.index("times as fast") < done.stdout.index("Fastest to each target") < done.stdout.index("Report: out")
    verdicts = open_results(tmp_path / "out").verdicts
    assert set(verdicts.target) == {0.1, 0.03} and verdicts.seconds.notna().all()
    for name in ("Steady", "Other"):
        assert f"{name.lower()}" in done.stdout.lower()
    again = sweeping.raybench("plan", "race.yaml", "--allow-imports", "-o", "out", cwd=tmp_path)
    assert "18 cells in 3 blocks: 18 done." in again.stdout, "the file is the experiment that was run"
    assert (tmp_path / "race.yaml").read_text().startswith("# raybench race ball.yaml")


def test_a_cell_ends_at_half_of_the_smallest_target(tmp_path):
    path = sweeping.write(tmp_path)
    limits = ["budget.max_spp=4096", "repeats=1", "budget.stop_at_error=0.05", "quality.targets=[0.1]"]
    sweeping.run(path, tmp_path / "out", limits)
    points = open_results(tmp_path / "out").points
    for _, cell in points.groupby("cell_id"):
        errors = cell.sort_values("spp").error.tolist()
        assert errors[-1] <= 0.05 < min(errors[:-1], default=math.inf) and cell.spp.max() < 4096


@needs("mitsuba-llvm")
def test_engines_of_several_lineages_race_in_the_open_division_with_the_samplers_they_have():
    written, notes = race._by_images(["cornell_box"], {"engine": ["numba", "mitsuba"]}, [0.01], None, NOTHING_ALLOWED)
    assert written["zip"] == {"engine": ["numba", "mitsuba"], "sampler": ["sobol", "orthogonal"]}
    assert written["division"] == "open" and written["matrix"]["precision"] == ["float32"]
    assert len(notes) == 2 and "numba sobol, mitsuba orthogonal" in notes[1]


def test_an_engine_may_be_a_mapping_with_a_python_of_its_own():
    given = [{"name": "numpy", "python": "this"}, "numpy"]
    written, _ = race._by_images(["cornell_box"], {"engine": given}, [0.1], None, (False, True, False))
    assert written["matrix"]["engine"] == given and written["matrix"]["sampler"] == ["sobol"]


def test_samplers_of_one_engine_race_in_float64_in_the_scene_s_shape(tmp_path):
    written, notes = race._by_images(["cornell_box"], {"sampler": ["random", "sobol"]}, [0.01], None, NOTHING_ALLOWED)
    assert not notes and "zip" not in written and "division" not in written and written["resolution"] == [64, 64]
    assert written["matrix"]["engine"] == ["numba"] and written["budget"]["stop_at_error"] == 0.005
    path = tmp_path / "race.yaml"
    path.write_text(yaml.safe_dump(written))
    assert len(planner.make(config.load(path)).cells) == 18


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "-1"], "--to -1: errors above zero are expected"),
        (["--to", "fast"], "--to fast: errors above zero are expected"),
        (["--engine", "numbo"], "did you mean 'numba'"),
        (["--sampler", "sobel"], "did you mean 'sobol'"),
        (["--save", "race.txt"], "--save race.txt: must end in .yaml or .yml"),
        (["--engine", "{"], "--engine {: names separated by commas are expected"),
        (["--shader", "mine:Guided"], "run with --allow-imports if you trust it"),
    ],
)
def test_wrong_words_are_refused_in_one_line(tmp_path, monkeypatch, words, said):
    from typer.testing import CliRunner

    from engines.errors import RaybenchError
    from harness.cli import app

    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["race", "cornell_box", *words])
    assert isinstance(done.exception, RaybenchError) and said in str(done.exception)
    assert not (tmp_path / "results").exists()


def test_the_bar_goes_in_equal_steps_of_the_logarithm():
    assert [_share(1.0, error, 0.01) for error in (1.0, 0.1, 0.01, 0.001)] == [0.0, 0.5, 1.0, 1.0]
    assert _share(0.005, 0.005, 0.01) == 1.0 and _share(0.1, 0.2, 0.01) == 0.0


def test_a_reference_has_as_many_samples_as_its_target_needs_within_its_time(tmp_path, monkeypatch):
    """Every pixel has the same noise. In no time there are the fewest samples, 256; a smaller error takes more."""
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "references"))  # another test may have made one of more samples
    path, found = sweeping.write(tmp_path), []
    for target, time in ((1e-3, "0.0001ms"), (1.0, "600s"), (1e-3, "600s")):
        out = tmp_path / f"{target} {time}"
        chosen = ["reference.spp=auto", f"reference.max_time={time}", f"quality.targets=[{target}]"]
        sweeping.run(path, out, [*chosen, "repeats=1", "budget.max_spp=2"])
        results = open_results(out).results
        (reference,) = results.references.values()
        assert results.manifest.reference_spp == {reference.reference_id: reference.spp}
        found.append(reference.spp)
    assert found[0] == 256 < found[1] < found[2]
    (wanted,) = planner.make(config.load(path, chosen), True).references.values()
    root = reference_files.cache_folder()
    enough = reference_samples.sufficiency(wanted, root, config.load(path, chosen).quality)
    assert enough.enough, "the reference that was made is the one that its own estimate asks for"
