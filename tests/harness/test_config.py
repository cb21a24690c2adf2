"""Experiment files: what the keys mean, and that every mistake is one message with its place."""

import json
import re
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from engines.choices import Choice
from engines.errors import ConfigError
from engines.schema.yaml_file import parse_yaml
from harness import config
from harness.config import experiment_schema, paths, settings
from harness.config.experiment import KEYS
from harness.config.settings import SETTINGS

ROOT = Path(__file__).resolve().parent.parent.parent

FULL = """\
raybench_experiment: 1
name: engines on two scenes
.defaults: &d {threads: 2}
resolution: [64, 48]
matrix:
  scene: [cornell_box, two_spheres]
  engine: [numpy, numba, embree]
  threads: [1, 2]
  accelerator: [none, grid, bvh]
  shader: [{name: path_tracer, max_depth: 6}]
  sampler: [random, halton, sobol]
zip: []
exclude: [{engine: numpy, threads: {ge: 2}}]
include: [{scene: cornell_box, engine: embree, accelerator: embree}]
extend: [{where: {engine: numba}, set: {precision: float32}}]
budget: {max_time: 20s, max_spp: 1024, timeout: 5m}
checkpoints: {ratio: 1.4142, start: 1}
repeats: 5
order: {seed: 1}
reference: {engine: embree, spp: 8192, seed: 9000}
quality: {metric: relmse, epsilon: 1e-2, targets: [1.0e-1, 1e-2, 0.001]}
"""
HEAD = "raybench_experiment: 1\nscene: cornell_box\n"


def parsed(text: str, overrides: tuple[str, ...] = ()) -> config.Experiment:
    root = parse_yaml(text, "a.yaml", ConfigError)
    for override in overrides:
        root = config.override(root, override)
    return config.parse(root, ROOT)


def named(experiment: config.Experiment, *keys: str) -> list[tuple]:
    """The combinations, as the names of some of their settings."""
    found = []
    for combination in experiment.combinations:
        values = [getattr(combination, key) for key in keys]
        found.append(tuple(getattr(v, "name", v) for v in values))
    return found


def test_the_example_of_the_specification_is_read():
    experiment = parsed(FULL)
    assert experiment.name == "engines on two scenes"
    assert len(experiment.combinations) == 2 * 3 * 2 * 3 * 3 - 2 * 1 * 1 * 3 * 3 + 1
    assert experiment.combinations[0].budget == config.Budget(max_time_seconds=20.0, max_spp=1024, timeout_seconds=300.0)
    assert experiment.checkpoints.ratio == 2**0.5, "1.4142 means the root of two"
    assert experiment.reference.replicates == (256, 32)
    assert experiment.quality.targets == (0.1, 0.01, 0.001)
    assert experiment.quality.name == "relmse_e0.01"
    assert {c.precision for c in experiment.combinations if c.engine == "numba"} == {"float32"}
    assert experiment.warnings == ()
    json.dumps(experiment.normalised())


def test_zip_advances_together_and_multiplies_the_matrix():
    text = HEAD + "matrix: {engine: [numpy, numba]}\nzip: [{threads: [1, 2], sampler: [random, sobol]}]\n"
    assert named(parsed(text), "engine", "threads", "sampler") == [
        ("numpy", 1, "random"),
        ("numpy", 2, "sobol"),
        ("numba", 1, "random"),
        ("numba", 2, "sobol"),
    ]


@pytest.mark.parametrize(
    ("rule", "left"),
    [
        ("{threads: {ge: 2}}", [1]),
        ("{threads: {gt: 1, lt: 4}}", [1, 4]),
        ("{threads: [1, 4]}", [2]),
        ("{threads: {le: 1}}, {threads: 4}", [2]),
        ("{engine: 'num*', threads: 2}", [1, 4]),
        ("{engine: embree}", [1, 2, 4]),
        ("{shader: path_tracer}", []),
        ("{shader: {name: path_*, max_depth: {ge: 6}}}", []),
        ("{shader: {max_depth: {lt: 6}}}", [1, 2, 4]),
        ("{resolution: [8, 8]}", [1, 2, 4]),
        ("{resolution: [[8, 8], [64, 48]]}", []),
        ("{resolution: 64x48}", []),
        ("{resolution: [8x8, 64x48]}", []),
        ("{scene: 'cornell*', threads: 1}", [2, 4]),
    ],
)
def test_exclude_matches_scalars_globs_lists_bounds_and_options(rule, left):
    text = HEAD + "engine: numba\nresolution: [64, 48]\nshader: {name: path_tracer, max_depth: 6}\n"
    text += f"matrix: {{threads: [1, 2, 4]}}\nexclude: [{rule}]\n"
    assert [threads for (threads,) in named(parsed(text), "threads")] == left


def test_a_rule_that_matches_nothing_is_a_warning_with_its_place():
    text = HEAD + "engine: numba\nexclude:\n  - {engine: numpy}\nextend: [{where: {threads: 7}, set: {threads: 1}}]\n"
    assert parsed(text).warnings == (
        "a.yaml:5 exclude[0]: this filter matches nothing",
        "a.yaml:6 extend[0].where: this filter matches nothing",
    )


def test_a_member_of_a_list_that_matches_nothing_is_a_warning_with_its_place():
    text = HEAD + "engine: numba\nmatrix: {threads: [1, 2]}\nexclude: [{threads: [2, 3]}]\n"
    text += "extend: [{where: {engine: [numba, numbo], resolution: [[8, 8], 9x9]}, set: {threads: 1}}]\n"
    assert parsed(text).warnings == (
        "a.yaml:5 exclude[0].threads[1]: 3 matches nothing",
        "a.yaml:6 extend[0].where: this filter matches nothing",
    )
    text = text.replace(", resolution: [[8, 8], 9x9]", "")
    assert parsed(text).warnings[1:] == ('a.yaml:6 extend[0].where.engine[1]: "numbo" matches nothing',)


def test_an_included_cell_takes_what_it_leaves_out_from_the_first_values():
    text = HEAD + "matrix: {engine: [numpy], threads: [2, 1], sampler: [halton]}\nexclude: [{engine: numpy}]\n"
    text += "include: [{engine: embree, accelerator: {name: embree, quality: high}}]\n"
    (cell,) = parsed(text).combinations
    assert (cell.threads, cell.sampler.name, cell.engine) == (2, "halton", "embree")
    assert cell.accelerator == Choice("embree", {"quality": "high"})


def test_budgets_are_merged_down_to_the_cell():
    text = HEAD + "matrix: {engine: [numpy, numba]}\nbudget: {max_time: 2s, max_spp: 64}\n"
    text += "extend: [{where: {engine: numpy}, set: {budget: {max_spp: 4}}}]\n"
    numpy, numba = (combination.budget for combination in parsed(text).combinations)
    assert (numpy.max_spp, numpy.max_time_seconds, numba.max_spp) == (4, 2.0, 64)


def test_equal_combinations_are_one():
    assert len(parsed(HEAD + "matrix: {engine: [numba, numba], threads: [1, 1.0]}\n").combinations) == 1


def test_anchors_and_merges_work():
    text = "raybench_experiment: 1\n.d: &d {threads: 2}\n<<: *d\nscene: cornell_box\nengine: numba\n"
    assert named(parsed(text), "threads") == [(2,)]


@pytest.mark.parametrize(
    ("written", "seconds"), [("20s", 20), ("500ms", 0.5), ("5m", 300), ("1.5 h", 5400), ("2min", 120), (".5s", 0.5)]
)
def test_durations_carry_their_unit(written, seconds):
    text = HEAD + f"engine: numba\nbudget: {{timeout: {written}}}\n"
    assert parsed(text).combinations[0].budget.timeout_seconds == pytest.approx(seconds)


def test_overrides_reach_into_sections_and_are_checked_like_the_file():
    experiment = parsed(FULL, ("repeats=1", "budget.max_time=2s", "matrix.engine=[numba]", "quality.targets=auto"))
    assert experiment.repeats == 1 and experiment.quality.targets is None
    assert experiment.combinations[0].budget.max_time_seconds == 2.0
    assert {engine for (engine,) in named(experiment, "engine")} == {"numba", "embree"}, "include stays"


MISTAKES = {
    "repeets: 3": "a.yaml:4 repeets: unknown key: did you mean 'repeats'?",
    "repeats: true": "a.yaml:4 repeats = True: must be an integer in [1, 1000]",
    "repeats: 1.5": "a.yaml:4 repeats = 1.5: must be an integer in [1, 1000]",
    "repeats: 2\nrepeats: 3": "a.yaml:5: 'repeats' is there twice: first in line 4, again in line 5",
    "budget: {max_time: 20}": "a.yaml:4 budget.max_time = 20: must be a time with its unit: 500ms, 20s, 5m or 1h",
    "budget: {max_time: 0s}": "a.yaml:4 budget.max_time = '0s': must be a time above zero and below thirty days",
    "budget: {maxtime: 20s}": "a.yaml:4 budget.maxtime: unknown key: did you mean 'max_time'?",
    "budget: 5s": "a.yaml:4 budget = '5s': a mapping is expected",
    "threads: 0": "a.yaml:4 threads = 0: must be an integer in [1, 1024]",
    "threads: yes": "a.yaml:4 threads = 'yes': must be an integer in [1, 1024]",
    "precision: double": "a.yaml:4 precision = 'double': must be one of float64, float32",
    "resolution: [64]": "a.yaml:4 resolution: width and height are expected, as 256x192 or [256, 192]",
    "resolution: [64, 0]": "a.yaml:4 resolution[1] = 0: must be an integer in [1, 65536]",
    "shader: path_tracr": "a.yaml:4 shader: unknown shader 'path_tracr': did you mean 'path_tracer'?",
    "shader: {name: whitted, depth: 2}": "a.yaml:4 shader: unknown option of shader 'whitted' 'depth': did you mean 'm",
    "shader: {max_depth: 2}": "a.yaml:4 shader: the key 'name' is expected",
    "shader: true": "a.yaml:4 shader = True: a shader's name, or {name: ..., option: value}, is expected",
    "sampler: sobel": "a.yaml:4 sampler: unknown sampler 'sobel': did you mean 'sobol'?",
    "matrix: {engine: [numba]}": "a.yaml:4 matrix.engine: stands elsewhere too",
    "matrix: {engin: [numba]}": "a.yaml:4 matrix.engin: unknown key: did you mean 'engine'?",
    "matrix: {threads: 2}": "a.yaml:4 matrix.threads = 2: a list of at least 1 is expected",
    "matrix: {threads: []}": "a.yaml:4 matrix.threads: a list of at least 1 is expected",
    "matrix:\n  threads: [1, two]": "a.yaml:5 matrix.threads[1] = 'two': must be an integer in [1, 1024]",
    "zip: [{threads: [1], sampler: [sobol, random]}]": "a.yaml:4 zip[0]: lists that advance together must be equ",
    "exclude: [{}]": "a.yaml:4 exclude[0]: at least one condition is expected",
    "exclude: {engine: numba}": "a.yaml:4 exclude: a list is expected",
    "exclude: [{thread: 2}]": "a.yaml:4 exclude[0].thread: unknown key: did you mean 'threads'?",
    "exclude: [{threads: {gee: 2}}]": "a.yaml:4 exclude[0].threads.gee: unknown key: did you mean 'ge'?",
    "exclude: [{engine: {ge: 2}}]": "a.yaml:4 exclude[0].engine: bounds are for numbers",
    "exclude: [{threads: {ge: two}}]": "a.yaml:4 exclude[0].threads.ge = 'two': must be a number in",
    "extend: [{set: {threads: 2}}]": "a.yaml:4 extend[0].where: is missing",
    "order: {policy: abab}": "a.yaml:4 order.policy: unknown key: known: seed",
    "checkpoints: {ratio: 1}": "a.yaml:4 checkpoints.ratio = 1: must be a number in [1.01, 1024]",
    "checkpoints: {ratio: .inf}": "a.yaml:4 checkpoints.ratio = inf: must be a number in [1.01, 1024]",
    "quality: {metric: rmse}": "a.yaml:4 quality.metric = 'rmse': must be one of relmse, trimmed_relmse, mse, mae, mape, smape",
    "quality: {epsilon: 0}": "a.yaml:4 quality.epsilon = 0: must be a number in (0, 1e+06]",
    "quality: {targets: [0.1, -1]}": "a.yaml:4 quality.targets[1] = -1: must be a number in (0, 1e+30]",
    "quality: {targets: automatic}": "a.yaml:4 quality.targets = 'automatic': a list of errors, or auto, is expected",
    "quality: {metric: psnr}": "a.yaml:4 quality: targets are expected with psnr",
    "quality: {metric: ssim, targets: [0.9, 1.5]}": "a.yaml:4 quality.targets: must be below 1",
    "reference: {engine: embre}": "a.yaml:4 reference.engine = 'embre': unknown engine: did you mean 'embree'?",
    "reference: {spp: 1}": "a.yaml:4 reference.spp = 1: must be an integer in [2, 2147483648]",
    "reference:\n  seed: 2": "a.yaml:5 reference.seed: seeds 2 and up are the reference's, 1 to 3 the cells'",
    "images: every": "a.yaml:4 images = 'every': must be one of all, some, last, none",
    "aa_twin: 1": "a.yaml:4 aa_twin = 1: must be true or false",
    "pairs: [{contestant: {engine: numba}}]": "a.yaml:4 pairs[0].baseline: is missing",
    "pairs: [{contestant: {}, baseline: {engine: numba}}]": "a.yaml:4 pairs[0].contestant: at least one setting is expected",
    "same_within: 0": "a.yaml:4 same_within = 0: must be a number in (0, 1]",
    "name: [a]": "a.yaml:4 name: a line of text is expected",
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_with_file_line_key_and_what_is_wanted(mistake):
    with pytest.raises(ConfigError) as caught:
        parsed(HEAD + f"engine: numba\n{mistake}\n")
    assert str(caught.value).startswith(MISTAKES[mistake])


def test_the_former_order_policy_is_a_warning_and_else_nothing():
    experiment = parsed(f"{HEAD}engine: numba\norder: {{policy: blocks, seed: 5}}\n")
    assert experiment == parsed(f"{HEAD}engine: numba\norder: {{seed: 5}}\n")
    assert experiment.warnings == ("a.yaml:4 order.policy is no longer needed: cells always run in blocks",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: x\n", "a.yaml:1: 'raybench_experiment: 1' is expected: this is no experiment"),
        ("raybench_experiment: 2\n", "a.yaml:1 raybench_experiment = 2: must be 1"),
        ("raybench_experiment: true\n", "a.yaml:1 raybench_experiment = True: must be 1"),
        ("raybench_experiment: 1\n", "a.yaml:1: a matrix is expected, or at least a scene and an engine"),
        ("raybench_experiment: 1\nengine: numba\n", "a.yaml:1: no scene is given"),
        (HEAD + "engine: numbra\n", "a.yaml:3 engine = 'numbra': unknown engine: did you mean 'numba'?"),
        ("raybench_experiment: 1\nengine: numba\nscene: cornel_box\n", "a.yaml:3 scene: unknown scene 'cornel_box'"),
        ("raybench_experiment: 1\nengine: numba\nscene: a/b.yaml\n", "a.yaml:3 scene: scene 'a/b.yaml': there is no"),
        ("- 1\n", "a.yaml:1: a mapping is expected"),
        ("", "a.yaml:1: empty"),
    ],
)
def test_a_file_that_is_no_experiment_is_refused(text, message):
    with pytest.raises(ConfigError) as caught:
        parsed(text)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("repeats", "--set repeats: must look like budget.max_time=5s"),
        ("a..b=1", "--set a..b=1: must look like budget.max_time=5s"),
        ("repeets=2", "--set repeets: unknown key: did you mean 'repeats'?"),
        ("repeats=many", "--set repeats = 'many': must be an integer in [1, 1000]"),
        ("budget.max_time=5", "--set budget.max_time = 5: must be a time with its unit"),
        ("repeats.x=5", "a.yaml:18 repeats = 5: a mapping is expected"),
    ],
)
def test_a_wrong_override_is_told_as_one(override, message):
    with pytest.raises(ConfigError) as caught:
        parsed(FULL, (override,))
    assert str(caught.value).startswith(message)


def test_a_matrix_that_explodes_is_refused_before_it_is_built():
    many = "[" + ", ".join(str(i) for i in range(1, 1001)) + "]"
    with pytest.raises(ConfigError, match="combinations: at most 100000 are allowed"):
        parsed(HEAD + f"matrix: {{engine: [numba], threads: {many}}}\nzip: [{{precision: {['float32'] * 500}}}]\n")


# --- the normalised file --------------------------------------------------------------------------------------------

OTHER = """\
raybench_experiment: 1
name: 2024
question: Which?
revision: {numba: 3f2c, mitsuba*: 2024}
matrix:
  scene: [cornell_box, {file: scenes/lantern.xml, parameters: {reflectance: 0.5}}]
  engine: [numba, 'mine:Engine', configs/renderers/raybench.yaml, {name: mitsuba, python: this}]
shader: 'mine:shader'
sampler: {name: multijitter, sample_count: 16}
accelerator: {name: embree, quality: high}
resolution: 64x48
division: open
budget: {max_time: 0.1ms, timeout: 1.5 h}
limits: {memory: 1.5 GiB}
timing: false
aa_twin: true
pairs: [{contestant: {engine: numba, threads: 1}, baseline: {sampler: multijitter}}]
reference: {engine: numba, certify: null, shader: whitted}
quality: {metric: psnr, targets: [20, 30.5]}
equivalence: {tile: 0.1}
verify: {cases: [stability], timeout: 90s}
"""


@pytest.mark.parametrize("text", [FULL, OTHER, HEAD + "engine: numba\n"], ids=["full", "other", "least"])
def test_the_normalised_experiment_is_a_valid_file_of_the_same_experiment(text, validator, monkeypatch):
    """From YAML, or as a manifest's config, it is the same again; elsewhere nothing that it names is sought."""
    monkeypatch.chdir(ROOT)
    experiment = parsed(text)
    said = experiment.normalised()
    assert said == json.loads(json.dumps(said)) and list(validator.iter_errors(said)) == []
    assert parsed(yaml.safe_dump(said)) == experiment and parsed(yaml.safe_dump(said)).normalised() == said
    monkeypatch.setattr(paths, "find", None)
    monkeypatch.setattr(settings, "known_names", list)
    monkeypatch.setattr(settings, "interpreter", None)
    assert config.recorded(said, "manifest.json").normalised() == said


def test_every_key_of_a_file_is_in_the_normalised_one():
    """But for those that make the combinations, which stand in `include`."""
    made = {"matrix", "zip", "exclude", "extend"}
    said, cell = parsed(OTHER).normalised(), parsed(FULL).normalised()["include"][-1]
    assert set(said) | {"baseline"} == set(KEYS.keys) - made - set(SETTINGS)
    assert set(cell) | {"precision", "rays"} == set(SETTINGS)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"quality": {"epsilon": 3e9}}, "manifest.json config.quality.epsilon = 3000000000.0: must be a number in (0, 1e+06]"),
        ({"repeets": 1}, "manifest.json config.repeets: unknown key: did you mean 'repeats'?"),
        ({"include": [{"engine": 3}]}, "manifest.json config.include[0].engine = 3: a name is expected"),
        ({"combinations": []}, "manifest.json config.combinations: unknown key"),
    ],
)
def test_a_config_in_a_manifest_is_refused_with_its_place(said, message):
    with pytest.raises(ConfigError) as caught:
        config.recorded({"raybench_experiment": 1, "include": [], **said}, "manifest.json")
    assert str(caught.value).startswith(message)


@pytest.fixture(scope="module")
def validator():
    schema = json.loads(json.dumps(experiment_schema()))
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def plain(text):
    return parse_yaml(text, "a.yaml", ConfigError).plain()


def test_the_schema_accepts_what_the_program_reads(validator):
    assert list(validator.iter_errors(plain(FULL))) == []
    odd = f"{HEAD}engine: numba\nname: 2024\nsampler: {{name: multijitter, sample_count: 16}}\nprecision: null\n"
    for text in (odd, f"{HEAD}zip: {{engine: [numba, embree], precision: [float32, float64]}}\nbaseline: numba\n"):
        parsed(text)
        assert list(validator.iter_errors(plain(text))) == []


def descriptions(properties, where=""):
    """Path and description of every key, those in sections and lists included."""
    for key, value in properties.items():
        yield f"{where}{key}", value.get("description", "")
        for each in (value, *value.get("anyOf", ())):
            yield from descriptions(each.get("items", each).get("properties", {}), f"{where}{key}.")


def test_the_schema_explains_every_key_and_its_defaults_are_those_of_an_empty_file():
    schema = experiment_schema()["properties"]
    sections = {key: value for key, value in schema.items() if value.get("type") == "object" and key != "matrix"}
    explained = list(descriptions(schema))
    assert len(explained) > 100
    assert [where for where, text in explained if not re.fullmatch(r"[A-Z].*\.", text)] == []
    empty = parsed(f"{HEAD}engine: numba\n")
    defaults = {key: value["default"] for key, value in schema.items() if "default" in value}
    defaults |= {
        key: {name: inner["default"] for name, inner in value["properties"].items() if "default" in inner}
        for key, value in sections.items()
    }
    del defaults["verify"]  # without the section nothing is verified
    lines = [f"{key}: {json.dumps(value)}\n" for key, value in defaults.items()]
    written = parsed(f"{HEAD}engine: numba\n{''.join(lines)}")
    assert written == empty


@pytest.mark.parametrize("name", sorted(paths.shipped("configs")))
def test_the_schema_accepts_every_shipped_experiment(validator, name):
    assert list(validator.iter_errors(plain(paths.shipped("configs")[name].read_text()))) == []


@pytest.mark.parametrize(
    "wrong",
    [
        "matrx: {engine: [numba]}",
        "engine: nmba",
        "threads: 0",
        "budget: {max_time: 20}",
        "images: yes",
        "zip: [{enginee: [numba]}]",
        "quality: {targets: []}",
        "exclude: [{threads: {gee: 2}}]",
    ],
)
def test_an_editor_is_told_of_mistakes_by_the_schema(validator, wrong):
    assert list(validator.iter_errors(plain(f"{HEAD}{wrong}\n")))
