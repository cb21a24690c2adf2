"""`raybench trace`: planted faults are counted to the last ray, bad input is one line, results can be read again."""

import json
import shutil

import jsonschema
import numpy as np
import pytest

from engines.errors import ConfigError
from engines.scene import load_scene
from engines.schema.yaml_file import parse_yaml
from harness.analysis.tracing import trace_table
from harness.config import paths, read_file
from harness.run.trace import run
from harness.trace.experiment import TRACE, load_trace, trace_of, trace_schema
from harness.trace.rays import hard_rays, make_rays
from harness.trace.records import read_trace
from harness.trace.truth import Truth
from tests.harness.faulty_tracers import EVERY
from tests.harness.sweeping import raybench

COUNT, HARD = 400, 100
GRAZING = 0.03
SMALL = {
    "scene": "cornell_box",
    "rays": ["camera", "shadow"],
    "count": COUNT,
    "checked": COUNT,
    "hard": HARD,
    "repeats": 1,
    "max_time": "1ms",
}


def options(**given):
    return [word for key, value in given.items() for word in (f"--{key.replace('_', '-')}", str(value))]


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trace")
    names = ["numpy", *(f"faulty_tracers:{name}" for name in ("Drops", "Misnames", "Crashes", "Short"))]
    return run(trace_of({**SMALL, "engine": names}), folder, lambda text: None, allow_imports=True)


def entry(results, engine, kind):
    return next(each for each in results.entries if (each.engine, each.rays) == (engine, kind))


@pytest.fixture(scope="module")
def exact():
    """Which rays of each set hit anything; and which shadow rays do not graze the light, as those from the ceiling do, so that
    rounding cannot say whether they reach it."""
    scene = load_scene(paths.find("scenes", "cornell_box"))
    truth = Truth(scene)
    sets = {kind: make_rays(kind, scene, truth, COUNT, 3, 1) for kind in ("camera", "shadow")}
    assert len(hard_rays(truth, HARD, 1).t_max) == HARD
    directions = sets["shadow"].directions
    steep = np.abs(directions[:, 1]) > GRAZING * np.linalg.norm(directions, axis=1)
    return {kind: truth.closest(*rays).item >= 0 for kind, rays in sets.items()} | {"steep": steep}


def test_an_engine_without_faults_has_none(measured):
    for kind in ("camera", "shadow"):
        answers = entry(measured, "numpy", kind).answers
        assert (answers.checked, answers.faults, answers.hard, answers.leaks) == (COUNT, 0, HARD, 0)


def test_dropped_hits_are_counted_as_misses_and_leaks(measured, exact):
    for kind in ("camera", "shadow"):
        answers = entry(measured, "drops", kind).answers
        assert (answers.wrong, answers.missed, answers.false_hits) == (0, exact[kind][::EVERY].sum(), 0)
        assert answers.leaks == HARD // EVERY


def test_hits_of_another_primitive_are_wrong_and_darkness_where_nothing_is_is_a_false_hit(measured, exact):
    answers = entry(measured, "misnames", "camera").answers
    assert (answers.wrong, answers.missed, answers.false_hits) == (exact["camera"][::EVERY].sum(), 0, 0)
    assert answers.wrong > 10
    answers = entry(measured, "misnames", "shadow").answers
    assert (answers.wrong, answers.missed, answers.false_hits) == (0, 0, (~exact["shadow"] & exact["steep"])[::EVERY].sum())
    assert answers.false_hits > 10


def test_an_engine_that_fails_has_a_line_and_no_rate(measured):
    crashed, short = (entry(measured, name, "camera") for name in ("crashes", "short"))
    assert (crashed.state, crashed.message, crashed.timings) == ("failed", "ValueError: no such ray", [])
    assert short.state == "failed" and "have t of shape (399,)" in short.message
    assert entry(measured, "crashes", "shadow").state == "done"


def test_rates_are_rays_over_seconds_and_ratios_those_of_the_baseline(measured):
    rows = {(row["engine"], row["rays"]): row for row in trace_table(measured).rows}
    base, other = rows["numpy", "camera"], rows["drops", "camera"]
    timing = entry(measured, "drops", "camera").timings[0]
    assert other["mrays_per_second"].value == pytest.approx(1e-6 * COUNT * timing.passes / timing.seconds)
    assert base["verdict"] == "baseline"
    assert other["ratio"].value == pytest.approx(other["mrays_per_second"].value / base["mrays_per_second"].value)
    assert other["verdict"] == "unresolved", "one block decides nothing"
    wrong = other["missed"] / COUNT
    assert other["error_rate"].low < wrong < other["error_rate"].high
    assert base["error_rate"].high == pytest.approx(1 - 0.05 ** (1 / COUNT))


def test_the_command_writes_results_that_report_reads_again(tmp_path, with_plots):
    words = [
        "cornell_box",
        *options(
            engine="numpy", rays="incoherent", count=300, checked=300, hard=50, repeats=3, max_time="1ms", out=tmp_path / "out"
        ),
    ]
    done = raybench("trace", *words, "--json")
    assert done.returncode == 0, done.stderr
    printed, written = json.loads(done.stdout), read_trace(tmp_path / "out" / "trace.json")
    assert printed == written.model_dump(mode="json")
    assert [each.twin for each in written.entries] == [False, True]
    assert [len(each.timings) for each in written.entries] == [3, 3] and not any(each.unstable for each in written.entries)
    shutil.rmtree(tmp_path / "out" / "plots")
    (tmp_path / "out" / "report.html").unlink()
    done = raybench("report", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out" / "plots").glob("*.svg"))
    assert "0 (below" not in (tmp_path / "out" / "tables" / "trace.csv").read_text()
    assert "Rays per second and wrong answers" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cornel_box"], "unknown scene 'cornel_box': did you mean 'cornell_box'?"),
        (["cornell_box", "--rays", "diffuse"], "rays[0] = 'diffuse': must be one of camera, shadow, incoherent"),
        (["cornell_box", "--engine", "numbe"], "unknown engine: did you mean 'numba'?"),
        (["cornell_box", "--engine", "my:engine"], "run with --allow-imports if you trust it"),
        (["cornell_box", "--engine", "numpy", "--accelerator", "octree"], "accelerator 'octree': none of the engines has it"),
        (["cornell_box", "--count", "3"], "count = 3: must be an integer in [16,"),
        (["cornell_box", "--repeats", "0"], "repeats = 0: must be an integer in [1,"),
        (["cornell_box", "--max-time", "2"], "max_time = '2': must be a time with its unit"),
        (["cornell_box", "--precision", "half"], "precision[0] = 'half': must be one of float64, float32"),
        (["cornell_box", "--baseline", "embreee"], "baseline = 'embreee': must be one of the engines"),
        (["furnace", "--engine", "numpy", "--rays", "shadow", "--out", "{file}"], "name a folder that can be written to"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, arguments, message):
    file = tmp_path / "file"
    file.touch()
    done = raybench("trace", *(each.format(file=file / "below") for each in arguments), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr and len(done.stderr.strip().splitlines()) == 1


def test_a_file_is_refused_where_it_is_wrong(tmp_path):
    for text, message in (
        ("rayz: camera", "unknown key: did you mean 'rays'?"),
        ("scene: []", "a list of at least 1 is expected"),
        ("batch: 0", "must be an integer in [1,"),
    ):
        path = tmp_path / "wrong.yaml"
        first = "" if text.startswith("scene") else "scene: cornell_box\n"
        path.write_text(f"raybench_trace: 1\n{first}{text}\n")
        with pytest.raises(ConfigError, match=r"wrong.yaml:\d") as caught:
            load_trace(path)
        assert message in str(caught.value)
    (tmp_path / "trace.json").write_text('{"raybench_trace_results": 9}')
    with pytest.raises(ConfigError, match="format 9, this raybench reads 3"):
        read_trace(tmp_path / "trace.json")


def test_run_takes_a_file_of_a_comparison_by_rays(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text("raybench_trace: 1\nscene: cornell_box\nrays: camera\nengine: numpy\ncount: 100\nhard: 0\nrepeats: 1\n")
    done = raybench("run", path, "--out", tmp_path / "out", "--set", "max_time=1ms")
    assert done.returncode == 0, done.stderr
    assert "cornell_box, 36 primitives: camera rays, 1 thread; 100 rays checked, 0 hard rays" in done.stdout
    assert read_trace(tmp_path / "out" / "trace.json").entries[0].answers.faults == 0
    assert raybench("run", path, "--fresh").returncode == 2


def test_the_shipped_file_says_its_question_and_the_schema_takes_it():
    names = [name for name, path in paths.shipped("configs").items() if read_file(path).says(TRACE)]
    assert names == ["trace"]
    experiment = load_trace("trace")
    text = paths.shipped("configs")["trace"].read_text()
    assert text.startswith(f"# {experiment.question}")
    assert np.isfinite(experiment.max_time_seconds) and len(experiment.contestants) == 3
    assert not list(jsonschema.Draft202012Validator(trace_schema()).iter_errors(parse_yaml(text).plain()))


def test_files_outside_of_the_scenes_folder_are_read_only_if_allowed(tmp_path):
    scene = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
        "materials": {"m": {"kd": 0.5}},
        "shapes": [{"mesh": {"file": "../m.obj"}, "material": "m"}],
    }
    (tmp_path / "m.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "s.yaml").write_text(json.dumps(scene))
    sizes = {"count": 50, "checked": 50, "hard": 20, "repeats": 1, "max_time": "1ms"}
    words = options(rays="camera", engine="numpy", out=tmp_path / "out", **sizes)
    refused = raybench("trace", "inner/s.yaml", *words, cwd=tmp_path)
    assert refused.returncode == 2 and "outside" in refused.stderr and "Traceback" not in refused.stderr
    assert raybench("trace", "inner/s.yaml", *words, "--allow-outside", cwd=tmp_path).returncode == 0
