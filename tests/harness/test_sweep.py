"""Whole sweeps with fake engines in real worker processes: what is recorded, and that mishaps stay small."""

import shutil

import numpy as np
import pytest
import yaml

from engines.errors import ConfigError
from engines.image import read_film_layers, read_provenance
from harness import config, store
from harness.analysis import analyse, targets
from harness.plan import planner
from harness.store import validation
from harness.store.records import Targets
from harness.store.results import load_results, point_error
from tests.harness import sweeping
from tests.harness.synthetic import SMALL, base_cell

ENGINES = "['fake_engines:Steady', 'fake_engines:Other']"


def with_engines(*names):
    return sweeping.EXPERIMENT.replace(ENGINES, str([f"fake_engines:{name}" for name in names]))


def cells(folder):
    return list(store.latest_cells(store.read_events(folder)).values())


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A sweep of two engines, with images, to its end."""
    folder = tmp_path_factory.mktemp("finished")
    text = with_engines("Phased", "Other").replace("images: none", "images: some")
    path = sweeping.write(folder, text.replace("repeats: 2", "repeats: 3"))
    outcome, listener = sweeping.run(path, folder / "out")
    return path, folder / "out", outcome, listener


def test_every_cell_is_measured_in_the_planned_order(finished):
    path, _, outcome, listener = finished
    made = planner.make(config.load(path), allow_imports=True)
    assert outcome.states == {"done": 18} and outcome.measured == 18, "two engines and four twins, three blocks"
    assert listener.cells == [cell.cell_id for cell in made.cells]


def test_an_event_says_all_that_was_asked_and_measured(finished):
    for event in cells(finished[1]):
        assert event.state == "done" and event.threads == 1 and (event.width, event.height) == (12, 8)
        assert event.precision == "float64" and event.shader.name == "path_tracer"
        phases = ("import", "load", "build", "warm_build", "compile", "render")
        assert event.phases.model_fields_set == {f"{phase}_seconds" for phase in phases}
        assert [point.spp for point in event.points] == [1, 2, 4, 8]
        assert {"load_1m", "steal_seconds", "involuntary_switches", "contended"} <= event.machine.model_fields_set
        assert event.machine.timed_seconds == pytest.approx(event.points[-1].seconds, abs=1e-6)
        assert event.attempt == 1 and not event.separate_renders and event.counters["rays"] == 8 * 96
        assert event.command.startswith("raybench render ") and "--spp 8 " in event.command


def test_phases_are_those_of_the_engine_and_warm_rendering_is_alone_on_the_clock(finished):
    for event in cells(finished[1]):
        if event.engine == "phased":
            phases = event.phases
            assert phases.build_seconds >= 0.05 and phases.compile_seconds >= 0.1  # what was slept, at least
            assert phases.warm_build_seconds >= 0.05
            assert phases.render_seconds == event.points[-1].seconds >= 8 * 0.02


def test_the_warm_up_pass_is_not_in_the_image(finished):
    """Seed and samples fix a fake image: the recorded error is that of samples 0 to 7 alone."""
    import fake_engines

    from harness.metrics import measure

    out = finished[1]
    event = cells(out)[0]
    reference = store.reference_arrays(out, event.reference_id)
    noise = [np.random.default_rng([event.seed, i]).normal(0, fake_engines.NOISE, (8, 12, 3)) for i in range(8)]
    image = fake_engines.truth(12, 8) + np.mean(noise, axis=0)
    assert event.points[-1].metrics["mse"] == pytest.approx(measure(image, reference, 0.01)["mse"], rel=1e-9)


def test_images_hold_the_layers_and_where_they_come_from(finished):
    out = finished[1]
    for event in cells(out):
        kept = [point.spp for point in event.points if point.image]
        later = [8] if event.label else [1, 4, 8]
        assert kept == ([1, 2, 4, 8] if event.block == 0 and not event.label else later)
        path = out / event.points[-1].image
        layers, told = read_film_layers(path), read_provenance(path)
        assert np.allclose(layers.mean, (layers.half0 + layers.half1) / 2, atol=1e-5)
        assert told["cell_id"] == event.cell_id and told["spp"] == 8 and told["spec"]["seed"] == event.seed


def test_a_sampler_with_patterns_is_measured_at_whole_ones_each_rendered_anew(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Patterned") + "sampler: stratified\n")
    outcome, _ = sweeping.run(path, tmp_path / "out", ["budget.max_spp=64", "repeats=1"])
    assert outcome.states == {"done": 1}
    (event,) = cells(tmp_path / "out")
    assert event.separate_renders and [point.spp for point in event.points] == [4, 16, 64]
    assert [point.sampler.options["strata"] for point in event.points] == [4, 16, 64] and event.counters["strata"] == 64
    assert [point.rays for point in event.points] == [4, 16, 64], "of each render alone"
    assert "strata: 64" in event.command and len(load_results(tmp_path / "out").contestants) == 1


def test_the_second_run_does_nothing(finished):
    path, out, _, _ = finished
    before = (out / store.EVENTS).read_bytes()
    outcome, listener = sweeping.run(path, out)
    assert outcome.measured == 0 and listener.cells == []
    assert (out / store.EVENTS).read_bytes() == before


def test_the_config_of_a_manifest_is_a_file_that_runs_again(finished, tmp_path):
    """Beside the same code and with the same results it finds all measured."""
    _, out, _, _ = finished
    again = tmp_path / "again.yaml"
    again.write_text(yaml.safe_dump(store.read_manifest(out).config))
    shutil.copytree(out, tmp_path / "out")
    outcome, listener = sweeping.run(again, tmp_path / "out")
    assert outcome.measured == 0 and listener.cells == [] and outcome.states
    assert store.read_manifest(tmp_path / "out").cell_ids == store.read_manifest(out).cell_ids


def test_manifest_and_run_event_tell_what_ran_where(finished):
    _, out, _, _ = finished
    events, manifest = store.read_events(out), store.read_manifest(out)
    assert [event.event for event in events][:3] == ["run", "environment", "targets"]
    assert manifest.config["repeats"] == 3 and manifest.machine["cpu"]
    assert {event.env_id for event in cells(out)} == {manifest.env_id}


def test_rescoring_changes_no_number_but_by_float32(finished):
    from harness.run.rescore import rescore

    out = finished[1]
    before = {e.cell_id: [p.metrics["mse"] for p in e.points] for e in cells(out)}
    scored, without = rescore(out)
    assert (scored, without) == (2 * 4 + 4 * 3 + 12, 4 + 12 * 3)
    for event in cells(out):
        assert [p.metrics["mse"] for p in event.points] == pytest.approx(before[event.cell_id], rel=1e-5)


def test_rescoring_for_another_quality_is_recorded_and_loses_no_score(finished, tmp_path):
    from harness.run.rescore import rescore

    out = shutil.copytree(finished[1], tmp_path / "out")
    changes = ["quality.epsilon=0.1", "quality.targets=auto"]
    rescore(out, changes, ["raybench", "rescore"])
    results = load_results(out)
    assert results.metric == "relmse_e0.1" and results.epsilon == 0.1 and len(results.targets) == 4
    assert results.runs[-1].command == ("raybench", "rescore")
    pictured = [point.metrics for event in cells(out) for point in event.points if point.image]
    assert all(scores["relmse_e0.1"] < scores["relmse_e0.01"] for scores in pictured)
    targets_before = results.targets
    rescore(out)
    assert load_results(out).targets == targets_before, "auto targets are resolved once"
    with pytest.raises(ConfigError, match="repeats: unknown key"):
        rescore(out, ["repeats=3"])


def test_one_failing_cell_does_not_stop_the_sweep(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Broken", "Steady"))
    outcome, _ = sweeping.run(path, tmp_path / "out")
    assert outcome.states == {"done": 3, "failed": 1}
    ((cell, event),) = outcome.failures
    assert (cell.engine_name, cell.seed) == ("broken", 2)
    assert event.message == "ValueError: the tree fell over and more"
    assert "the tree fell over" in (tmp_path / "out" / "worker.log").read_text()


def test_fail_fast_stops_and_a_later_run_goes_on(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Crashing", "Steady"))
    outcome, _ = sweeping.run(path, tmp_path / "out", fail_fast=True)
    assert outcome.stopped and outcome.states["failed"] == 1 and outcome.states["queued"] >= 1
    outcome, _ = sweeping.run(path, tmp_path / "out")
    assert outcome.states == {"done": 2, "failed": 2}
    assert {event.message for _, event in outcome.failures} == {"the engine's process was killed by SIGSEGV"}


def test_failed_cells_are_left_alone_until_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_TEST_MEND", str(tmp_path / "mended"))
    path = sweeping.write(tmp_path, with_engines("Mended"))
    assert sweeping.run(path, tmp_path / "out")[0].states == {"done": 1, "failed": 1}
    assert sweeping.run(path, tmp_path / "out")[0].measured == 0
    (tmp_path / "mended").touch()
    outcome, _ = sweeping.run(path, tmp_path / "out", retry=True)
    assert outcome.measured == 1 and outcome.states == {"done": 2}


def test_a_timeout_kills_the_cell_keeps_its_points_and_goes_on(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Hanging", "Steady").replace("timeout: 20s", "timeout: 4s"))
    outcome, _ = sweeping.run(path, tmp_path / "out", ["repeats=1"])
    assert outcome.states == {"done": 1, "timeout": 1}
    ((_, event),) = outcome.failures
    assert event.message == "killed after 4 s" and [point.spp for point in event.points] == [1, 2]


def test_skipped_cells_are_recorded_once_with_their_reason(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Picky", "Steady"))
    for _ in range(2):
        outcome, listener = sweeping.run(path, tmp_path / "out")
        assert outcome.states == {"done": 2, "skipped": 2} and not outcome.failures
        assert [note for note in listener.notes if "skipped" in note] == ["picky is skipped: it never feels like it"]
    skipped = [e for e in store.read_events(tmp_path / "out") if getattr(e, "state", None) == "skipped"]
    assert [event.message for event in skipped] == ["it never feels like it"] * 2


def test_an_engine_that_prints_and_starts_threads_is_measured_all_the_same(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Chatty", "Steady"))
    outcome, _ = sweeping.run(path, tmp_path / "out")
    assert outcome.states == {"done": 4}
    assert "hello from an engine" in (tmp_path / "out" / "worker.log").read_text()


def test_a_reference_that_fails_fails_its_cells_only(tmp_path):
    path = sweeping.write(tmp_path, with_engines("Steady"))
    outcome, listener = sweeping.run(path, tmp_path / "out", ["reference.engine=fake_engines:Crashing"])
    assert outcome.states == {"failed": 2} and "no reference: " in outcome.failures[0][1].message
    assert len(listener.notes) == 1
    assert sweeping.run(path, tmp_path / "out")[0].states == {"done": 2}


def test_results_put_aside_by_a_smaller_plan_count_again(tmp_path):
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    sweeping.run(path, out)
    before = sweeping.rows(out)
    assert sweeping.run(path, out, ["repeats=1"])[0].states == {"done": 2}
    assert sorted(row[0] for row in sweeping.rows(out).values()) == ["done", "done", "outdated", "outdated"]
    outcome, _ = sweeping.run(path, out)
    assert outcome.measured == 0 and sweeping.rows(out) == before


def test_another_reference_makes_results_outdated(tmp_path):
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    sweeping.run(path, out)
    outcome, _ = sweeping.run(path, out, ["reference.seed=9500"])
    assert outcome.measured == 4 and outcome.states == {"done": 4}


def test_a_target_in_trimmed_relmse_is_measured_with_the_noise_of_its_reference(tmp_path):
    """The noise of a reference of 16 times the samples leaves a quarter of it in the error."""
    path = sweeping.write(tmp_path)
    errors = {}
    for spp in (16, 256):
        out = tmp_path / f"out{spp}"
        sweeping.run(path, out, ["quality={metric: trimmed_relmse, targets: [1.0, 0.1]}", f"reference.spp={spp}"])
        results = load_results(out)
        assert (results.metric, results.targets) == ("relmse_e0.01_trimmed", [1.0, 0.1])
        points = [point for cell in results.cells for point in cell.points]
        errors[spp] = [point.metrics["relmse_e0.01_trimmed_se"] for point in points]
        assert all(point_error(point, results.metric)[1] > 0 for point in points)
        found = analyse(results)
        assert set(found.by_target.measure) == {"time to 1", "time to 0.1"} and found.by_target.seconds.gt(0).all()
    assert sum(errors[256]) < 0.5 * sum(errors[16])


def test_automatic_targets_are_resolved_once(tmp_path):
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    sweeping.run(path, out, ["quality.targets=auto", "repeats=1"])
    first = store.last_event(store.read_events(out), Targets)
    assert first is not None and first.metric == "relmse_e0.01" and len(first.targets) == targets.COUNT
    sweeping.run(path, out, ["quality.targets=auto", "budget.max_spp=64"])
    assert [e for e in store.read_events(out) if e.event == "targets"] == [first]


def test_automatic_targets_are_round_falling_and_reachable():
    def cell(scene, error, state="done"):
        made = base_cell((scene, "numba", "bvh", "random", 1, None), 0, SMALL)
        point = {"spp": 1, "seconds": 1.0, "metrics": {"mse": error}, "image": None}
        return validation.event({**made, "state": state, "points": [point]}, "a cell")

    cells = [cell("a", e) for e in (0.02, 0.025, 0.2)] + [cell("b", 1e-4), cell("b", 9.0, "failed")]
    assert targets.automatic_targets(cells, "mse") == [1.0, 0.3, 0.1, 0.03]
    assert targets.automatic_targets([cell("a", float("nan"))], "mse") == []


def test_a_scene_that_changes_while_the_sweep_runs_is_noticed(tmp_path):
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    made = planner.make(config.load(path), allow_imports=True)
    (tmp_path / "ball.yaml").write_text(sweeping.SCENE.replace("radius: 1", "radius: 2"))
    from harness.run import sweep

    with store.locked(out):
        outcome = sweep.run(made, out, sweep.Options(allow_imports=True), sweeping.Quiet())
    assert outcome.states == {"failed": 4}
    assert "the scene has changed since the run began" in outcome.failures[0][1].message


def test_two_runs_in_one_folder_are_refused(tmp_path):
    path = sweeping.write(tmp_path)
    with store.locked(tmp_path / "out"), pytest.raises(ConfigError, match="another run"):
        sweeping.run(path, tmp_path / "out")
