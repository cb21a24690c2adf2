"""Cells: what they are called, in which order they run, and why some do not."""

import json
import random
import sys
from dataclasses import asdict, replace
from types import MappingProxyType

import pytest
import yaml

from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError
from engines.interface import FullPattern
from engines.peers.external import Engine as Program
from engines.peers.mitsuba import Engine as MitsubaEngine
from engines.schema.yaml_file import parse_yaml
from harness import config
from harness.config.experiment import FEWEST_TWINS
from harness.config.paths import shipped
from harness.hashing import canonical_json, digest
from harness.plan import answers, loaded, planner, state
from harness.store import records
from harness.store.records import Point
from tests import needs
from tests.harness import fake_engines, sweeping


def planned(folder, text=sweeping.EXPERIMENT, overrides=()):
    return planner.make(config.load(sweeping.write(folder, text), overrides), allow_imports=True)


def ids(made):
    return {cell.cell_id for cell in made.cells}


def test_a_command_names_a_shipped_scene_by_its_name_and_others_by_path(tmp_path):
    shipped, own = (
        planner.make(config.load(sweeping.write(tmp_path, sweeping.EXPERIMENT.replace("ball.yaml", name))), True)
        for name in ("cornell_box", "ball.yaml")
    )
    assert shipped.cells[0].command(4).startswith("raybench render cornell_box --engine")
    assert own.cells[0].command(4).startswith(f"raybench render {tmp_path / 'ball.yaml'} --engine")


def test_without_a_shader_that_of_the_scene_is_taken_and_one_that_sees_its_media(tmp_path):
    (tmp_path / "volpath.xml").write_text(
        '<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="9"/></integrator>'
        '<sensor type="perspective"/><shape type="sphere"/><emitter type="constant"/></scene>'
    )
    found = {}
    for name in ("cornell_box", "milk", "volpath.xml"):
        text = sweeping.EXPERIMENT.replace("ball.yaml", name).replace(
            "['fake_engines:Steady', 'fake_engines:Other']", "[numpy]"
        )
        found[name] = planned(tmp_path, text).cells[0].settings.shader
    assert (found["cornell_box"].name, found["milk"].name) == ("path_tracer", "volumetric_path_tracer")
    assert (found["volpath.xml"].name, found["volpath.xml"].options["max_depth"]) == ("path_tracer", 9)
    idle = planned(tmp_path, sweeping.EXPERIMENT + "exclude: [{shader: {name: no_shadows}}]\n")
    assert len(idle.cells) == len(planned(tmp_path).cells)


def test_a_command_allows_imports_where_the_cell_needs_them(tmp_path):
    plain = sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", "[numpy]")
    commands = [planned(tmp_path, text).cells[0].command(4) for text in (sweeping.EXPERIMENT, plain)]
    assert ["--allow-imports" in command for command in commands] == [True, False], commands


def test_numbers_have_one_spelling():
    assert canonical_json({"b": 1.0, "a": [1e-3, 2]}) == '{"a":[0.001,2],"b":1}'
    assert digest({"x": 1e-3}) == digest({"x": 0.001}) == digest({"x": 1.0e-3})


@pytest.mark.parametrize(
    ("written", "otherwise"),
    [
        ("matrix: {engine: ['fake_engines:Steady', 'fake_engines:Other']}", None),
        ("['fake_engines:Steady', 'fake_engines:Other']", "['fake_engines:Other', 'fake_engines:Steady']"),
        ("max_time: 5s, max_spp: 8, timeout: 20s", "timeout: 0.5m, max_spp: 8.0, max_time: 5000ms"),
        ("checkpoints: {ratio: 2, start: 1}", "checkpoints: {start: 1.0, ratio: 2.0e0}"),
        ("name: small", "name: another\nquestion: why?\n.x: &x {a: 1}"),
        ("targets: [1.0, 0.1]", "targets: [0.3]"),
        ("resolution: [12, 8]", "shader: {rr_depth: 5, name: path_tracer, max_depth: 16}\nresolution: [12, 8]"),
    ],
)
def test_ids_depend_on_what_is_asked_and_not_on_how_it_is_written(tmp_path, written, otherwise):
    if otherwise is None:
        otherwise = "matrix:\n  engine:\n  - fake_engines:Other\n  - fake_engines:Steady\n"
    assert written in sweeping.EXPERIMENT
    first, second = planned(tmp_path), planned(tmp_path, sweeping.EXPERIMENT.replace(written, otherwise))
    assert ids(first) == ids(second)
    assert [c.cell_id for c in first.cells] == [c.cell_id for c in second.cells], "the order is part of what is asked"
    assert list(first.references) == list(second.references)


@pytest.mark.parametrize(
    "change", ["resolution=[13, 8]", "threads=2", "budget.max_spp=16", "seed=5", "sampler=random", "checkpoints.start=2"]
)
def test_ids_change_with_what_is_asked(tmp_path, change):
    assert not ids(planned(tmp_path)) & ids(planned(tmp_path, overrides=[change]))


def test_a_changed_scene_changes_every_id_and_the_reference(tmp_path):
    before = planned(tmp_path)
    path = sweeping.write(tmp_path)
    (tmp_path / "ball.yaml").write_text(sweeping.SCENE.replace("radius: 1", "radius: 0.9"))
    after = planner.make(config.load(path), allow_imports=True)
    assert not ids(before) & ids(after) and not set(before.references) & set(after.references)


def test_a_new_version_of_an_engine_is_another_request(tmp_path, monkeypatch):
    import fake_engines

    before = ids(planned(tmp_path))
    monkeypatch.setattr(fake_engines.Other, "version", "2")
    after = ids(planned(tmp_path))
    assert len(before & after) == 2, "the other engine's cells stay"


def test_each_block_holds_every_cell_once_in_its_own_order(tmp_path):
    text = sweeping.EXPERIMENT.replace("repeats: 2", "repeats: 6\nzip: {threads: [1, 2, 3, 4]}")
    made = planned(tmp_path, text)
    blocks = [[c.configuration + str(c.label) for c in made.cells if c.block == block] for block in range(6)]
    assert all(sorted(block) == sorted(blocks[0]) for block in blocks)
    assert len({tuple(block) for block in blocks}) > 1
    assert [cell.order for cell in made.cells] == list(range(len(made.cells)))
    assert [cell.seed for cell in made.cells] == [1 + cell.block for cell in made.cells]


def test_the_random_state_of_the_program_is_not_touched(tmp_path):
    random.seed(3)
    state = random.getstate()
    planned(tmp_path)
    assert random.getstate() == state


def test_a_control_runs_one_configuration_under_two_labels(tmp_path):
    made = planned(tmp_path, overrides=["aa_twin=true"])
    control = [cell for cell in made.cells if cell.label]
    assert len(control) == 2 * FEWEST_TWINS
    assert len({cell.cell_id for cell in made.cells}) == len(made.cells)
    for cell in control:
        same = [c for c in made.cells if c.configuration == cell.configuration and c.seed == cell.seed]
        (original,) = [c for c in same if not c.label]
        assert original.cell_id != cell.cell_id and original.settings == cell.settings
    assert not any(cell.label for cell in planned(tmp_path).cells), "too few repeats for one"


def twins_of(made):
    """(scene, engine, sampler, label) of the twins of the first block, sorted."""
    twins = [cell for cell in made.cells if cell.label and cell.block == 0]
    return sorted((c.scene.name, c.engine_name, c.settings.sampler.name, c.label) for c in twins)


def test_a_run_of_one_scene_and_two_contestants_has_four_twins(tmp_path):
    """Two of each; the same ones whenever it is planned."""
    text = sweeping.EXPERIMENT.replace("repeats: 2", "repeats: 3")
    labels = [planner.AA_LABEL, f"{planner.AA_LABEL} 2"]
    expected = [("ball", engine, "sobol", label) for engine in ("other", "steady") for label in labels]
    assert twins_of(planned(tmp_path, text)) == twins_of(planned(tmp_path, text)) == expected
    assert not twins_of(planned(tmp_path, text, ["timing=false"]))
    assert not twins_of(planned(tmp_path, text, ["aa_twin=false"]))


def test_twins_are_spread_over_scenes_and_engines(tmp_path):
    """Two scenes have two twins each, five have one; of each engine, and in each scene of one that it has."""
    engines = "['fake_engines:Steady', 'fake_engines:Other']"
    for count, each in ((2, 2), (5, 1)):
        names = [f"ball{index}" for index in range(count)]
        for index, name in enumerate(names):
            (tmp_path / f"{name}.yaml").write_text(sweeping.SCENE.replace("radius: 1", f"radius: {1 + index}"))
        files = [f"{name}.yaml" for name in names]
        text = sweeping.EXPERIMENT.replace("scene: ball.yaml\n", "").replace("repeats: 2", "repeats: 3")
        text = text.replace(f"engine: {engines}", f"scene: [{', '.join(files)}], engine: {engines}, sampler: [sobol, random]")
        found = twins_of(planned(tmp_path, text + "exclude: [{scene: ball1, engine: '*Other'}]\n"))
        assert [name for name, *_ in found] == [name for name in names for _ in range(each)]
        assert {engine for _, engine, _, _ in found} == {"steady", "other"}
        assert {engine for name, engine, _, _ in found if name == "ball1"} == {"steady"}


PATTERNED = sweeping.EXPERIMENT.replace("fake_engines:Other", "fake_engines:Patterned") + "sampler: stratified\n"


def test_samplers_with_patterns_have_whole_ones_as_checkpoints(tmp_path):
    """Checkpoints 1, 2, 4, ..., 100: each pattern once, none of more than the budget."""
    made = planned(tmp_path, PATTERNED, ["budget.max_spp=100"])
    steady, patterned = ({c.engine_name: c for c in made.cells}[name] for name in ("steady", "patterned"))
    assert not steady.patterns and "patterns" not in steady.spec
    assert [(each.spp, each.sampler["strata"]) for each in patterned.patterns] == [(4, 4), (16, 16), (64, 64)]
    assert patterned.spec["patterns"][1] == {"spp": 16, "sampler": {"name": "stratified", "strata": 16}}
    assert [asdict(each) for each in patterned.request(made.experiment.checkpoints).patterns] == patterned.spec["patterns"]
    assert "strata: 16" in patterned.command(16) and "strata: 64" in patterned.command(64)
    assert state.budgeted_seconds(patterned) == pytest.approx(5.0 * (4 + 16 + 64) / 64 + state.OVERHEAD_SECONDS, rel=1e-3)
    small = {c.engine_name: c.skip for c in planned(tmp_path, PATTERNED, ["budget.max_spp=3"]).cells}
    assert small["steady"] is None and "no whole pattern of its sampler has at most 3 samples" in small["patterned"]
    free = planned(tmp_path, PATTERNED, ["sampler=random"])
    assert not any(cell.patterns for cell in free.cells)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda spp: 4, "returned 4: None is expected, or a FullPattern of 1 samples or more"),
        (lambda spp: FullPattern(1, {"name": "stratified"}), "a FullPattern of 2 samples or more"),
        (lambda spp: FullPattern(spp, {}), "with its sampler"),
        (lambda spp: 1 // 0, "full_pattern failed: ZeroDivisionError"),
    ],
)
def test_patterns_that_are_none_are_refused(tmp_path, monkeypatch, answer, words):
    import fake_engines

    monkeypatch.setattr(fake_engines.Patterned, "full_pattern", lambda self, sampler, spp: answer(spp))
    with pytest.raises(ConfigError, match=f"engine patterned: .*{words}"):
        planned(tmp_path, PATTERNED)


def test_what_an_engine_cannot_do_is_skipped_with_its_reason(tmp_path):
    text = sweeping.EXPERIMENT.replace("fake_engines:Other", "fake_engines:Picky")
    skipped = [cell for cell in planned(tmp_path, text).cells if cell.skip]
    assert {(cell.engine_name, cell.skip) for cell in skipped} == {("picky", "it never feels like it")}


def test_an_accelerator_of_one_engine_is_skipped_by_another(tmp_path):
    made = planned(tmp_path, overrides=["accelerator=tree"])
    reasons = {cell.engine_name: cell.skip for cell in made.cells}
    assert reasons == {"other": None, "steady": "the engine fake_engines:Steady has no accelerator tree"}


def test_precision_is_float64_unless_asked_for_or_there_is_only_float32(tmp_path):
    text = sweeping.EXPERIMENT.replace("fake_engines:Other", "fake_engines:Single")
    assert {(c.engine_name, c.settings.precision) for c in planned(tmp_path, text).cells} == {
        ("steady", "float64"),
        ("single", "float32"),
    }
    cells = planned(tmp_path, text, ["precision=float64"]).cells
    assert {c.skip for c in cells if c.engine_name == "single"} == {"it has float32 alone"}


class Unsure(fake_engines.Steady):
    """Draws other numbers in every process."""

    not_promised = MappingProxyType({"seeds_matter": "it draws from the clock"})


def test_a_cell_says_whether_its_sampler_is_smooth_and_its_engine_reproducible(tmp_path):
    """`random` alone of raybench's own; plugins and engines say so for theirs; a program's samplers are not known."""
    text = sweeping.EXPERIMENT.replace("matrix: {", "matrix: {sampler: [random, sobol, stratified, halton], ")
    smooth = {cell.settings.sampler.name: cell.smooth_sampler for cell in planned(tmp_path, text).cells}
    assert smooth == {"random": True, "sobol": False, "stratified": False, "halton": False}
    mitsuba = ("random", "independent"), ("stratified", "multijitter", "orthogonal", "ldsampler")
    found = [[answers.is_smooth(MitsubaEngine(), Choice(name), False) for name in names] for names in mitsuba]
    assert found == [[True] * 2, [False] * 4]
    assert not answers.is_smooth(Program("configs/renderers/raybench.yaml"), Choice("random"), False)
    assert all(cell.reproducible for cell in planned(tmp_path).cells)
    assert not answers.is_reproducible(Program("configs/renderers/raybench.yaml"))
    assert answers.is_reproducible(MitsubaEngine()) and not answers.is_reproducible(Unsure())


def test_a_sampler_s_plugin_says_whether_it_is_smooth(tmp_path, monkeypatch):
    (tmp_path / "own_samplers.py").write_text(
        "from engines.plugin import Sampler\nplain = Sampler('plain', smooth=True)\nnet = Sampler('net')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    found = [answers.is_smooth(fake_engines.Steady(), Choice(f"own_samplers:{name}"), True) for name in ("plain", "net")]
    assert found == [True, False]


@pytest.mark.parametrize("sampler", ["{name: multijitter, sample_count: 16}", "own_lattice:draws"])
def test_a_reference_takes_the_samplers_that_cells_take(sampler, tmp_path, monkeypatch):
    """Those of single engines, and plugins."""
    (tmp_path / "own_lattice.py").write_text("class draws:\n    name = 'lattice'\n    jitted = numpy = None\n")
    monkeypatch.syspath_prepend(tmp_path)
    made = planned(tmp_path, overrides=[f"reference.sampler={sampler}", f"sampler={sampler}"])
    (wanted,) = made.references.values()
    assert {cell.skip for cell in made.cells} == {None}
    assert wanted.spec["sampler"] == wanted.settings.sampler.describe() == made.cells[0].settings.sampler.describe()
    name = wanted.spec["sampler"]["name"]
    assert name in sampler and (name in wanted.spec["code"]) == (":" in name), "a plugin's code is part of what is asked"


def test_a_reference_refuses_a_sampler_that_nobody_knows(tmp_path):
    with pytest.raises(RaybenchError, match=r"reference\.sampler: unknown sampler 'sobel': did you mean 'sobol'"):
        planned(tmp_path, overrides=["reference.sampler=sobel"])


def test_without_a_reference_cells_are_skipped_with_the_reason(tmp_path):
    made = planned(tmp_path, overrides=["reference.engine=fake_engines:Picky"])
    assert {cell.skip for cell in made.cells} == {"no reference by fake_engines:Picky: it never feels like it"}


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("accelerator=tre", "unknown accelerator 'tre': did you mean 'tree'?"),
        ("accelerator={name: tree, leaf: 3}", "unknown option of accelerator 'tree' 'leaf'"),
        ("matrix.engine=['fake_engines:Stedy']", "fake_engines:Stedy: cannot be imported"),
        ("shader=nothing:here", "nothing:here: cannot be imported"),
        ("baseline=stedy", "baseline = 'stedy': no engine of this experiment: did you mean 'steady'?"),
        ("baseline={engine: [steady, stedy]}", 'no contestant of this experiment has engine "stedy"'),
        (
            "pairs=[{contestant: {engine: steady}, baseline: {engine: steady, threads: 64}}]",
            'pairs[0].baseline = {engine: "steady", threads: 64}: no contestant of this experiment has these settings',
        ),
    ],
)
def test_names_that_nobody_knows_are_errors_before_anything_runs(tmp_path, override, message):
    with pytest.raises(RaybenchError) as caught:
        planned(tmp_path, overrides=[override])
    assert message in str(caught.value)


def test_code_named_in_a_file_is_not_imported_unless_allowed(tmp_path):
    with pytest.raises(RaybenchError, match="run with --allow-imports if you trust it"):
        planner.make(config.load(sweeping.write(tmp_path)), allow_imports=False)


def measured(cell, **fields):
    """The record of a cell that was measured to its end."""
    said = ("cell_id", "configuration", "block", "seed", "scene_hash", "reference_id")
    own = {key: getattr(cell, key) for key in said} | cell.settings.fields()
    return records.Cell(**own, env_id="e", state="done", scene=cell.scene.name, engine=cell.engine_name, **fields)


def test_an_event_answers_its_cell_only_with_today_s_reference_and_metric(tmp_path):
    cell = planned(tmp_path).cells[0]
    point = Point(spp=1, seconds=0.1, metrics={"relmse_e0.01": 1.0}, image=None)
    event = measured(cell, points=(point,))
    assert state.state_of(cell, None, "mse") == "queued"
    assert state.state_of(cell, event, "relmse_e0.01") == "done"
    assert state.state_of(cell, event, "relmse_e0.1") == "outdated"
    assert state.state_of(cell, event.replaced(reference_id="old"), "relmse_e0.01") == "outdated"
    assert state.state_of(cell, event.replaced(state="timeout", points=()), "mse") == "timeout"
    assert state.state_of(replace(cell, skip="no"), event, "mse") == "skipped"


def test_expected_times_come_from_the_same_configuration_else_from_the_budget(tmp_path):
    first, *rest = planned(tmp_path).cells
    twin = next(cell for cell in rest if cell.configuration == first.configuration)
    other = next(cell for cell in rest if cell.configuration != first.configuration)
    events = {first.cell_id: measured(first, wall_seconds=0.7)}
    expected = state.expected_seconds([twin, other], events)
    assert expected[twin.cell_id] == (0.7, True)
    assert expected[other.cell_id] == (pytest.approx(5.0 + state.OVERHEAD_SECONDS, rel=1e-3), False), "96 pixels are scored"


def test_the_preimage_of_an_id_is_plain_data_and_complete(tmp_path):
    for cell in planned(tmp_path).cells:
        assert digest(json.loads(json.dumps(cell.spec))) == cell.cell_id
        assert {"scene", "engine", "engine_version", "shader", "seed", "width", "schema"} <= set(cell.spec)


@pytest.mark.parametrize("name", sorted(shipped("configs")))
def test_every_shipped_experiment_can_be_planned_and_says_its_question(name, monkeypatch, tmp_path):
    (tmp_path / "other").symlink_to(sys.prefix)
    monkeypatch.setenv("RAYBENCH_OTHER", str(tmp_path / "other"))
    experiment = config.load(name)
    text = shipped("configs")[name].read_text()
    assert experiment.name == name and experiment.question and text.startswith(f"# {experiment.question}")
    assert experiment.warnings == ()
    made = planner.make(experiment, allow_commands=True)
    again = config.parse(parse_yaml(yaml.safe_dump(experiment.normalised()), "again.yaml", ConfigError), tmp_path)
    assert again == experiment, "what a manifest holds is a valid file"
    same = planner.make(again, allow_commands=True)
    assert (same.cells, same.references.keys()) == (made.cells, made.references.keys())
    of_files = ("dropped, as the expected image", "black from behind", "light samples pass null surfaces")  # of Mitsuba's
    unsaid = [warning for warning in made.warnings if not any(note in warning for note in of_files)]
    refused = {cell.skip for cell in made.cells if cell.skip}
    expected = [needs.lacking("mitsuba-llvm") or "bpy is not installed", "bpy is not installed", "pyluxcore is not installed"]
    expected.append("does not support the medium")
    assert not unsaid and not [skip for skip in refused if not any(reason in skip for reason in expected)]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda self: 1 / 0, "engine other: accelerators failed: ZeroDivisionError"),
        (lambda self: sys.exit("no licence"), "engine other: accelerators failed: SystemExit: no licence"),
        (lambda self: ["tree"], r"engine other: accelerators returned \['tree'\]: a mapping"),
        (lambda self: {"tree": None}, "engine other: accelerators returned {'tree': None}: a mapping"),
    ],
)
def test_an_engine_that_cannot_list_its_accelerators_is_an_error_that_names_it(tmp_path, monkeypatch, answer, message):
    import fake_engines

    monkeypatch.setattr(fake_engines.Other, "accelerators", answer)
    with pytest.raises(RaybenchError, match=message):
        planned(tmp_path)


@pytest.mark.parametrize(("engine", "able"), [("fake_engines:Steady", True), ("{name: numpy, python: this}", False)])
def test_the_only_engine_makes_references_after_numba_where_it_may(engine, able, tmp_path, monkeypatch):
    """The file of a renderer, and an engine with a Python of its own, may make none."""
    monkeypatch.setattr(loaded, "REFERENCE_ENGINE", "fake_engines:Picky")
    made = planned(tmp_path, overrides=["reference.engine=null", f"matrix.engine=[{engine}]"])
    assert {wanted.spec["engine"] for wanted in made.references.values()} == ({engine} if able else set())
    assert {cell.skip for cell in made.cells} == {
        None if able else "no reference by fake_engines:Picky: it never feels like it"
    }


@pytest.mark.parametrize(
    ("engines", "by", "why_not"),
    [
        (["fake_engines:Steady", "fake_engines:Picky"], "fake_engines:Steady", None),
        (["fake_engines:Steady", "numpy"], None, "fake_engines:Steady and numpy can make it: reference.engine must name one"),
    ],
)
def test_of_several_engines_the_only_one_that_can_makes_references_after_numba(engines, by, why_not, tmp_path, monkeypatch):
    monkeypatch.setattr(loaded, "REFERENCE_ENGINE", "fake_engines:Picky")
    made = planned(tmp_path, overrides=["reference.engine=null", f"matrix.engine=[{', '.join(engines)}]"])
    assert {wanted.spec["engine"] for wanted in made.references.values()} == ({by} if by else set())
    assert any(cell.skip is None for cell in made.cells) == (why_not is None)
    assert why_not is None or all(cell.skip.endswith(why_not) for cell in made.cells)


def test_a_mitsuba_file_is_read_with_parameters_and_outside_of_its_folder_where_that_is_allowed(tmp_path):
    """Two values of a parameter are two scenes; the command and the request of a cell repeat what was given."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out.xml").write_text('<scene version="3.0.0"><shape type="sphere"><emitter type="area"/></shape></scene>')
    (tmp_path / "in" / "s.xml").write_text(
        '<scene version="3.0.0"><default name="side" value="1"/><sensor type="perspective"/><include filename="../out.xml"/>'
        '<shape type="sphere"><float name="radius" value="$side"/></shape></scene>'
    )
    given = "[in/s.xml, {file: in/s.xml, parameters: {side: 2}}]"
    text = sweeping.EXPERIMENT.replace("scene: ball.yaml\n", "").replace("matrix: {", f"matrix: {{scene: {given}, ")
    experiment = config.load(sweeping.write(tmp_path, text))
    with pytest.raises(RaybenchError, match=r"lies outside the scene's folder .* run with --allow-outside"):
        planner.make(experiment, allow_imports=True)
    plan = planner.make(experiment, allow_imports=True, allow_outside=True)
    cells = {cell.scene.name: cell for cell in plan.cells}
    assert set(cells) == {"s", "s side=2"} and len({cell.scene_hash for cell in cells.values()}) == 2
    assert "-D side=2 --allow-outside" in cells["s side=2"].command(4)
    request = cells["s side=2"].request(experiment.checkpoints)
    assert (request.scene.parameters, request.scene.allow_outside) == ((("side", "2"),), True)
    assert {wanted.scene.allow_outside for wanted in plan.references.values()} == {True}
    (outcome, _) = sweeping.run(tmp_path / "small.yaml", tmp_path / "out", allow_outside=True)
    assert outcome.states == {"done": 8}


def test_a_baseline_on_a_scene_with_parameters_that_tables_name_otherwise_is_refused(tmp_path):
    (tmp_path / "s.xml").write_text(
        '<scene version="3.0.0"><default name="side" value="1"/><sensor type="perspective"/>'
        '<shape type="sphere"><float name="radius" value="$side"/><emitter type="area"/></shape></scene>'
    )
    text = sweeping.EXPERIMENT.replace("ball.yaml", "{file: s.xml, parameters: {side: 2}}")
    path = sweeping.write(tmp_path, text)
    with pytest.raises(RaybenchError, match=r"baseline.scene = 's': no scene of this experiment: .*s side=2"):
        planner.make(config.load(path, ["baseline={scene: s}"]), allow_imports=True)
    found = planner.make(config.load(path, ["baseline={scene: 's side=2'}"]), allow_imports=True)
    assert found.experiment.baseline.matches(planner.settings_of(found.cells[0]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("{file: ball.yaml, parameters: {side: [1]}}", "a number or a word is expected"),
        ("{file: ball.yaml, parameters: {side: 1}}", "parameters are for Mitsuba's XML files"),
        ("{file: ball.yaml}", "parameters"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(tmp_path, given, words):
    path = sweeping.write(tmp_path, sweeping.EXPERIMENT.replace("ball.yaml", given))
    with pytest.raises(RaybenchError, match=words):
        planner.make(config.load(path), allow_imports=True)
