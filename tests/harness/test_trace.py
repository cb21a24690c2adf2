"""Cells that trace rays, and their command: planted faults are counted to the last ray, and rays are cells as others are."""

import json
import os
import shlex
import shutil
from pathlib import Path
from statistics import geometric_mean
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from engines.choices import Choice
from engines.errors import ConfigError, RendererFailed
from engines.scene import load_scene
from harness import config, store
from harness.analysis.rays import ray_races
from harness.cli import app, experiments
from harness.config import paths
from harness.config.settings import SceneFile
from harness.measure import jobs, scratch, tracing
from harness.measure.contention import Disturbance
from harness.measure.messages import Traced, Unwritten
from harness.measure.pool import Pool, ScratchUnwritten, WorkerFailed
from harness.measure.requests import RayRequest
from harness.plan import planner
from harness.report import write_derived
from harness.report.archive import archive
from harness.report.tables.rays import rays as rays_table
from harness.run import sweep
from harness.run.ray_sets import MadeRaySets
from harness.settings import TracerSettings
from harness.statistics import UNKNOWN_SPREAD, race
from harness.store.merge import merge
from harness.store.records import RayAttempt, RayCell, attempt_of
from harness.store.results import load_results
from harness.trace.rays import hard_rays, make_rays
from harness.trace.rays import why_not as why_no_rays
from harness.trace.truth import Truth
from tests.harness import sweeping
from tests.harness.faulty_tracers import EVERY, Faulty
from tests.harness.sweeping import raybench

COUNT, HARD = 400, 100
GRAZING = 0.03
BALL = """\
<scene version="3.0.0">
  <default name="radius" value="1"/>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
  </sensor>
  <shape type="sphere"><float name="radius" value="$radius"/></shape>
</scene>
"""
EXPERIMENT = f"""\
raybench_experiment: 1
name: small
scene: cornell_box
matrix:
  rays: [camera, shadow]
  engine: [numpy]
ray_sets: {{count: {COUNT}, checked: {COUNT}, hard: {HARD}}}
budget: {{max_time: 1ms}}
repeats: 1
remeasure: 0
"""


def options(**given):
    return [word for key, value in given.items() for word in (f"--{key.replace('_', '-')}", str(value))]


def engines(*names):
    return f"matrix.engine=[{', '.join(['numpy', *(f'faulty_tracers:{name}' for name in names)])}]"


def run(folder, overrides=(), text=EXPERIMENT):
    """The results of an experiment, and what the run said."""
    outcome, listener = sweeping.run(sweeping.write(folder, text), folder / "out", overrides)
    return load_results(folder / "out"), outcome, listener


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    return run(tmp_path_factory.mktemp("rays"), [engines("Drops", "Misnames", "Crashes", "Short")])[0]


def cell(results, engine, kind):
    return next(each for each in results.ray_cells if (each.engine, each.rays) == (engine, kind))


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
        answers = cell(measured, "numpy", kind).answers
        assert (answers.checked, answers.faults, answers.hard, answers.leaks) == (COUNT, 0, HARD, 0)


def test_dropped_hits_are_counted_as_misses_and_leaks(measured, exact):
    for kind in ("camera", "shadow"):
        answers = cell(measured, "drops", kind).answers
        assert (answers.wrong, answers.missed, answers.false_hits) == (0, exact[kind][::EVERY].sum(), 0)
        assert answers.leaks == HARD // EVERY


def test_hits_of_another_primitive_are_wrong_and_darkness_where_nothing_is_is_a_false_hit(measured, exact):
    answers = cell(measured, "misnames", "camera").answers
    assert (answers.wrong, answers.missed, answers.false_hits) == (exact["camera"][::EVERY].sum(), 0, 0)
    assert answers.wrong > 10
    answers = cell(measured, "misnames", "shadow").answers
    assert (answers.wrong, answers.missed, answers.false_hits) == (0, 0, (~exact["shadow"] & exact["steep"])[::EVERY].sum())
    assert answers.false_hits > 10


def test_an_engine_that_fails_has_a_line_and_no_rate(measured):
    crashed, short = (cell(measured, name, "camera") for name in ("crashes", "short"))
    assert (crashed.state, crashed.message, crashed.passes) == ("failed", "ValueError: no such ray", 0)
    assert short.state == "failed" and "have t of shape (399,)" in short.message
    assert cell(measured, "crashes", "shadow").state == "done"
    rows = {(row["engine"], row["rays"]): row for row in rays_table(measured).rows}
    assert rows["crashes", "camera"]["state"] == "failed" and "mrays_per_second" not in rows["crashes", "camera"]


def test_rates_are_rays_over_seconds_and_ratios_those_of_the_baseline(measured):
    rows = {(row["engine"], row["rays"]): row for row in rays_table(measured).rows}
    base, other = rows["numpy", "camera"], rows["drops", "camera"]
    event = cell(measured, "drops", "camera")
    assert other["mrays_per_second"].value == pytest.approx(1e-6 * COUNT * event.passes / event.seconds)
    assert base["verdict"] == "baseline"
    assert other["ratio"].value == pytest.approx(other["mrays_per_second"].value / base["mrays_per_second"].value)
    assert other["verdict"] == "unresolved", "one block decides nothing"
    wrong = other["missed"] / COUNT
    assert other["error_rate"].low < wrong < other["error_rate"].high
    assert base["error_rate"].high == pytest.approx(1 - 0.05 ** (1 / COUNT))


def raced(measured, seconds):
    """The two contestants of a race with these seconds a pass (2, blocks)."""
    results = load_results(measured.folder)
    base, other = (cell(measured, name, "camera") for name in ("numpy", "drops"))
    results.ray_cells = [
        each.replaced(cell_id=f"{row}{block}", block=block, passes=2 + block, seconds=(2 + block) * seconds[row, block])
        for row, each in enumerate((base, other))
        for block in range(seconds.shape[1])
    ]
    ((first, second),) = ray_races(results)
    return first, second


def test_ratios_are_those_of_a_race_in_seconds_a_pass(measured):
    rng = np.random.default_rng(1)
    seconds = np.exp(rng.normal([[0.0], [0.5]], 0.05, (2, 5)))
    first, second = raced(measured, seconds)
    assert first.baseline and first.settings.engine == "numpy" and first.ratio is None
    expected = race(np.log(seconds), np.log(seconds), [(1, 0)], UNKNOWN_SPREAD).ratios[0]
    assert second.ratio[:3] == pytest.approx(expected[:3])
    assert geometric_mean(second.rates()) == pytest.approx(1e-6 * COUNT / geometric_mean(seconds[1]))


def test_a_ratio_of_rays_is_no_better_known_than_the_clock_resolves(measured):
    """Times of two microseconds and of two seconds a pass, both 5 % longer, without noise."""
    short, long = (raced(measured, np.outer([scale, 1.05 * scale], np.ones(5)))[1].ratio for scale in (2e-6, 2.0))
    assert short.ratio == pytest.approx(1 / 1.05) == long.ratio
    assert short.low < 1 < short.high and long.high < 1


def test_the_baseline_is_the_first_contestant_as_written(tmp_path):
    results, _, _ = run(tmp_path, ["matrix.engine=['faulty_tracers:Drops', numpy]", "matrix.rays=[camera]"])
    assert [one.settings.engine for one in ray_races(results)[0] if one.baseline] == ["drops"]


def test_races_share_the_spread_of_four_twins_and_blocks_trace_the_same_rays(tmp_path):
    results, outcome, _ = run(tmp_path, [engines("Drops"), "repeats=3", "seed=5"])
    assert outcome.states == {"done": 24}
    races = ray_races(results)
    for group in races:
        assert [(one.settings.engine, one.settings.label) for one in group] == [
            (engine, label) for engine in ("numpy", "drops") for label in ("", "A/A")
        ]
        assert [len(one.done) for one in group] == [3, 3, 3, 3] and not any(one.unstable for one in group)
        assert len({each.ray_set_id for one in group for each in one.cells}) == 1
    assert len(races) == 2 and {one.spread.twins for group in races for one in group} == {4}
    assert len({one.spread for group in races for one in group}) == 1
    assert len({each.order for each in results.ray_cells}) == 24


def test_answers_that_differ_between_blocks_are_said(measured):
    results = load_results(measured.folder)
    first = cell(measured, "numpy", "camera")
    other = first.replaced(cell_id="other", block=1, answers=first.answers.replaced(sha256="another"))
    results.ray_cells = [first, other]
    assert [row["unstable"] for row in rays_table(results).rows] == [True]


def test_a_run_goes_on_and_other_sizes_are_measured_anew(tmp_path):
    _, outcome, listener = run(tmp_path)
    assert outcome.measured == 2 and sum("exact answers" in note for note in listener.notes) == 2
    _, outcome, listener = run(tmp_path)
    assert outcome.measured == 0 and not any("exact answers" in note for note in listener.notes)
    results, outcome, _ = run(tmp_path, ["ray_sets.count=200", "ray_sets.batch=64"])
    assert outcome.measured == 2 and {each.count for each in results.ray_cells} == {200}


def test_rays_and_images_stand_in_one_experiment(tmp_path):
    engines = "engine: ['fake_engines:Steady', 'fake_engines:Other']"
    text = sweeping.EXPERIMENT.replace(engines, "engine: [numpy], sampler: [random, sobol], rays: [null, camera]")
    results, outcome, _ = run(tmp_path, text=text + "ray_sets: {count: 50, hard: 0}\n")
    assert outcome.states == {"done": 6} and len(results.contestants) == 2, "two samplers in two blocks, and rays once in each"
    assert [(each.rays, each.scene) for each in results.ray_cells] == [("camera", "ball")] * 2
    report = write_derived(results.folder).read_text()
    assert "Rays per second and wrong answers" in report and "Do the engines make the same image?" in report
    assert not planner.make(config.load(sweeping.write(tmp_path / "only", EXPERIMENT))).references, "rays need none"


def test_what_cannot_be_traced_is_skipped_with_its_reason_and_what_cannot_be_made_has_failed(tmp_path):
    light = "raybench_scene: 1\ncamera: {type: perspective, eye: [0, 0, 5], target: [0, 0, 9]}\nmaterials: {m: {kd: 0.5}}\n"
    sweeping.write(tmp_path)
    (tmp_path / "dark.yaml").write_text(light + "shapes: [{sphere: {center: [0, 0, 0], radius: 1}, material: m}]\n")
    more = ["scene=dark.yaml", "matrix.rays=[camera, shadow, incoherent]", "matrix.accelerator=[auto, bvh]"]
    results, _, listener = run(tmp_path, more, EXPERIMENT.replace("[numpy]", "[numpy, embree]"))
    of = {(each.engine, each.rays, each.accelerator.name): each for each in results.ray_cells}
    assert of["numpy", "camera", "auto"].state == "done"
    assert "has no light that shadow rays could go to" in of["numpy", "shadow", "auto"].message
    assert of["numpy", "shadow", "auto"].state == of["embree", "camera", "bvh"].state == "skipped"
    assert "has no accelerator bvh" in of["embree", "camera", "bvh"].message
    assert of["numpy", "incoherent", "auto"].state == "failed"
    assert "no ray of the camera hits anything" in of["numpy", "incoherent", "auto"].message
    assert any("embree" in note and "skipped" in note for note in listener.notes)
    (tmp_path / "night.yaml").write_text((tmp_path / "dark.yaml").read_text().replace("radius: 1", "radius: 2"))
    path = sweeping.write(
        tmp_path, EXPERIMENT.replace("scene: cornell_box", "").replace("matrix:", "matrix:\n  scene: [dark.yaml, night.yaml]")
    )
    outcome, listener = sweeping.run(path, tmp_path / "stopped", ["matrix.rays=[incoherent]"], fail_fast=True)
    assert outcome.stopped and outcome.states == {"failed": 1, "queued": 1}, "no other set is made after the first failure"


def test_rays_are_not_traced_by_a_cluster(tmp_path):
    plan = planner.make(config.load(sweeping.write(tmp_path, EXPERIMENT)))
    with pytest.raises(ConfigError, match="--cluster tcp://x:1: rays are traced on this machine"):
        sweep.run(plan, tmp_path / "out", sweep.Options(cluster="tcp://x:1"), sweeping.Quiet())


def test_archives_and_merged_folders_keep_rays(measured, tmp_path):
    archive(measured.folder, tmp_path / "archive")
    kept = load_results(tmp_path / "archive")
    assert {each.cell_id for each in kept.ray_cells} == {each.cell_id for each in measured.ray_cells}
    assert cell(kept, "drops", "camera").answers == cell(measured, "drops", "camera").answers
    merge([measured.folder], tmp_path / "merged")
    merged = load_results(tmp_path / "merged")
    assert [row["missed"] for row in rays_table(merged).rows if row["engine"] == "drops"] == [
        row["missed"] for row in rays_table(measured).rows if row["engine"] == "drops"
    ]
    assert {each.measured_as for each in merged.ray_cells} == {each.cell_id for each in measured.ray_cells}


def test_a_measurement_that_does_not_count_is_an_attempt(measured):
    event = cell(measured, "numpy", "camera")
    found = attempt_of(event)
    assert isinstance(found, RayAttempt) and (found.passes, found.answers) == (event.passes, event.answers)
    assert isinstance(store.read_events(measured.folder)[-1], RayCell)


def test_the_command_is_an_experiment_that_report_reads_again(tmp_path, with_plots):
    words = [
        "cornell_box",
        *options(
            engine="numpy", rays="incoherent", count=300, checked=300, hard=50, repeats=3, max_time="1ms", out=tmp_path / "out"
        ),
    ]
    done = raybench("trace", *words, "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    names = ["numpy", "numpy (twin)", *(f"numpy (twin {number})" for number in (2, 3, 4))]
    assert [(row["engine"], row["blocks"], row["checked"]) for row in rows] == [(name, 3, 300) for name in names]
    assert not any(row["unstable"] for row in rows) and rows[0]["mrays_per_second_low"] > 0
    assert "9 passes" not in (again := raybench("trace", *words)).stderr and again.returncode == 0
    assert "cornell_box, 36 primitives: incoherent rays, 1 thread; 300 rays checked, 50 hard rays" in again.stdout
    assert "(4 twins)" in again.stdout
    shutil.rmtree(tmp_path / "out" / "plots")
    (tmp_path / "out" / "report.html").unlink()
    done = raybench("report", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out" / "plots").glob("rays-against-errors-*.svg"))
    assert "0 (below" not in (tmp_path / "out" / "tables" / "rays.csv").read_text()
    report = (tmp_path / "out" / "report.html").read_text()
    assert "Rays per second and wrong answers" in report and "Do the engines make the same image?" not in report
    assert "raybench race cornell_box --engine numpy --accelerator auto --threads 1 --rays incoherent" in report


def test_a_command_that_all_engines_decline_exits_with_2(tmp_path):
    done = raybench("trace", "cornell_box", *options(engine="numpy", precision="float32", out=tmp_path / "out", repeats=1))
    assert done.returncode == 2 and "numpy is skipped: " in done.stderr and "skipped" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cornel_box"], "unknown scene 'cornel_box': did you mean 'cornell_box'?"),
        (["cornell_box", "--rays", "diffuse"], "rays[0] = 'diffuse': must be one of camera, shadow, incoherent"),
        (["cornell_box", "--engine", "numbe"], "unknown engine: did you mean 'numba'?"),
        (["cornell_box", "--engine", "my:engine"], "run with --allow-imports if you trust it"),
        (["cornell_box", "--engine", "numpy", "--accelerator", "octree"], "unknown accelerator"),
        (["cornell_box", "--count", "3"], "count = 3: must be an integer in [16,"),
        (["cornell_box", "--max-time", "2"], "max_time = '2': must be a time with its unit"),
        (["cornell_box", "--precision", "half"], "precision[0] = 'half': must be one of float64, float32"),
        (["cornell_box", "--baseline", "embreee"], "baseline = 'embreee': no engine of this experiment"),
        (["furnace", "--engine", "numpy", "--rays", "shadow", "--out", "{file}"], "below: cannot be written: Not a directory"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, arguments, message):
    file = tmp_path / "file"
    file.touch()
    done = raybench("trace", *(each.format(file=file / "below") for each in arguments), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    note, *said = done.stderr.strip().splitlines()
    assert "is now `raybench race" in note and len(said) == 1 and message in said[0]


def test_a_file_is_refused_where_it_is_wrong(tmp_path):
    for override, message in (
        ("matrix.rayz=[camera]", "unknown key: did you mean 'rays'?"),
        ("matrix.rays=[diffuse]", "must be one of camera, shadow, incoherent"),
        ("ray_sets.batch=0", "must be an integer in [1,"),
        ("exclude=[{rays: {ge: 2}}]", "bounds are for numbers"),
    ):
        with pytest.raises(ConfigError) as caught:
            config.load(sweeping.write(tmp_path, EXPERIMENT), [override])
        assert message in str(caught.value)
    path = sweeping.write(tmp_path, "raybench_trace: 1\nscene: cornell_box\n")
    with pytest.raises(
        ConfigError, match=r"small.yaml:1: 'raybench_experiment: 1' is expected; comparisons by rays are experiments"
    ):
        config.load(path)


def test_a_cell_s_command_traces_it_again(tmp_path, monkeypatch):
    """With the parameters of a Mitsuba file, and a time of many digits."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.xml").write_text(BALL)
    scene = "scene: {file: ball.xml, parameters: {radius: 2}}"
    path = sweeping.write(tmp_path, EXPERIMENT.replace("scene: cornell_box", scene).replace("[camera, shadow]", "[camera]"))
    (cell,) = planner.make(config.load(path, ["budget.max_time=123456.75ms", "aa_twin=false"])).cells
    words = shlex.split(cell.command(1))
    assert words[words.index("--time") + 1] == "123.45675s"
    monkeypatch.setattr(experiments, "run", lambda file, folder, overrides, *_: found.append((file, overrides)) or 2)
    found = []
    CliRunner().invoke(app, words[1:], catch_exceptions=False)
    (again,) = planner.make(config.load(*found[0])).cells
    assert again.cell_id == cell.cell_id


def test_what_cannot_be_imported_has_no_exact_answers(tmp_path):
    shape = '<shape type="sphere"/><shape type="heightfield"/>'
    (tmp_path / "odd.xml").write_text(BALL.replace("</scene>", f"{shape}</scene>"))
    path = sweeping.write(tmp_path, EXPERIMENT.replace("cornell_box", "odd.xml"))
    scene = load_scene(tmp_path / "odd.xml", natively=True)
    assert scene.native.refusal and why_no_rays("camera", scene) == scene.native.refusal
    assert {cell.skip for cell in planner.make(config.load(path)).cells} == {scene.native.refusal}


def test_pairs_are_of_cells_that_render(tmp_path):
    pair = "pairs: [{contestant: {engine: numpy}, baseline: {engine: numpy}}]\n"
    with pytest.raises(ConfigError, match="pairs: they are of cells that render"):
        planner.make(config.load(sweeping.write(tmp_path, EXPERIMENT + pair)))


def test_filters_take_kinds_of_rays(tmp_path):
    path = sweeping.write(tmp_path, EXPERIMENT + "exclude: [{rays: shadow}]\n")
    assert [each.rays for each in config.load(path).combinations] == ["camera"]


def test_the_shipped_file_compares_three_engines():
    experiment = config.load("rays")
    assert {each.rays for each in experiment.combinations} == {"camera", "shadow", "incoherent"} and not experiment.renders
    assert len({each.engine for each in experiment.combinations}) == 3
    said = experiment.normalised()
    assert config.recorded(said, "manifest.json").normalised() == said and said["ray_sets"]["count"] == 50000


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


class Channel:
    """Stands for the parent's end of a worker's channel."""

    def __init__(self):
        self.sent = []

    def send(self, message):
        self.sent.append(message)


class Counting(Faulty):
    """Remembers how many rays each call had."""

    name = "counting"
    takes_native = False

    def __init__(self):
        self.sizes = []

    def spoilt(self, hits, scene):
        self.sizes.append(len(hits.t))
        return hits


def traced(folder, batch, channel=None):
    """What a worker does, in this process."""
    file = SceneFile("cornell_box", str(paths.find("scenes", "cornell_box")))
    scene = load_scene(file.path)
    rays = make_rays("camera", scene, Truth(scene), 100, 3, 1)
    tracing.write_rays(folder / "rays.npz", rays, np.arange(0, 100, 2), rays.take(np.arange(70)))
    settings = TracerSettings(Choice("auto"), None, 1)
    own = str(folder / "rays.npz"), "camera", batch, 1e-3, 50, 70
    request = RayRequest(file, scene.identity, settings, *own, scratch=str(folder / "scratch.npz"))
    engine, channel = Counting(), channel or Channel()
    jobs.trace(engine, request, channel)
    return engine.sizes, channel.sent, tracing.read_answers(folder / "scratch.npz", request)


def test_rays_are_traced_in_batches_whenever_an_engine_is_called(tmp_path, monkeypatch):
    windows = []
    stop = Disturbance.stop
    monkeypatch.setattr(Disturbance, "stop", lambda self, seconds: (stop(self, seconds), windows.append(self.window)))
    sizes, sent, answers = traced(tmp_path, 32)
    assert sizes[0] == 32 and sizes[-7:] == [32, 32, 32, 4, 32, 32, 6] and set(sizes) == {32, 4, 6}
    whole = traced(tmp_path, None)[2]
    assert answers.keys() == whole.keys() and all((answers[name] == whole[name]).all() for name in whole)
    found = next(each for each in sent if isinstance(each, Traced))
    assert found.passes >= 2 and found.began <= windows[0][0] < windows[found.passes - 1][1] == found.ended, "all the passes"


def test_answers_that_were_tampered_with_are_an_engines_failure(tmp_path):
    path, request = tmp_path / "film.npz", SimpleNamespace(kind="shadow", checked=3, hard=0)
    scratch.leave(path, blocked=np.zeros(3, bool), hard_blocked=np.zeros(0, bool))
    assert tracing.read_answers(path, request)["blocked"].shape == (3,)
    for arrays in ({"blocked": np.zeros(1 << 20, bool)}, {"blocked": np.zeros(3)}, {"blocked": np.zeros(2, bool)}, {}):
        scratch.leave(path, **{"hard_blocked": np.zeros(0, bool), **arrays})
        with pytest.raises(RendererFailed, match=r"cannot be read|its answers have blocked of (shape|dtype)"):
            tracing.read_answers(path, request)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(RendererFailed, match="the worker's answers cannot be read: NotRegularFile"):
        tracing.read_answers(path, request)


def test_rays_and_answers_on_a_full_disk_are_no_failure_of_the_engine(tmp_path, monkeypatch):
    savez = np.savez

    def full(path, **arrays):
        if Path(path).name != "rays.npz":
            raise OSError(28, "No space left on device")
        savez(path, **arrays)

    def ends(status):
        raise SystemExit(status)

    def refuses(*_):
        raise ScratchUnwritten("film.npz: cannot be written")

    plan = planner.make(config.load(sweeping.write(tmp_path, EXPERIMENT)))
    monkeypatch.setattr(np, "savez", full)
    with MadeRaySets(False) as sets, pytest.raises(ConfigError, match="cannot be written: No space left on device"):
        sets.of(plan.cells[0].ray_set)
    monkeypatch.setattr(jobs.os, "_exit", ends)
    channel = Channel()
    with pytest.raises(SystemExit):
        traced(tmp_path, None, channel)
    assert isinstance(channel.sent[-1], Unwritten) and "scratch.npz: cannot be written" in channel.sent[-1].message
    request = RayRequest(None, "", None, "", "camera", None, 1.0, 50, 70)
    for file, error in ((tmp_path, ConfigError), (tmp_path / "film.npz", WorkerFailed)):  # a folder is in the way
        with pytest.raises(error, match=r"film\.npz: cannot be written"):
            Pool._receive(SimpleNamespace(scratch=file), SimpleNamespace(receive=refuses), request, 0.0, Traced)


def test_a_primitive_that_no_shape_has_is_none():
    truth = Truth(load_scene(paths.find("scenes", "cornell_box")))
    huge = np.array([0, 2**63 - 1, -(2**63)])
    assert truth.item_of(np.ones(3, np.int64), huge).tolist()[1:] == [-1, -1]
    assert truth.item_of(np.array([0, 1]), np.zeros(2, np.int64)).min() >= 0
