"""Experiment files that somebody got wrong: a reading or a ConfigError of one line, and never long in coming."""

from __future__ import annotations

import copy
import math
import time
from pathlib import Path

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from engines.errors import ConfigError
from engines.scene.yaml_file import parse_yaml, read_yaml
from harness import config

ROOT = Path(__file__).resolve().parent.parent.parent
FULL = """\
raybench_experiment: 1
name: all keys
matrix:
  scene: [cornell_box, two_spheres]
  engine: [numpy, numba]
  threads: [1, 2]
  accelerator: [none, {name: grid}]
  shader: [{name: path_tracer, max_depth: 6}]
  sampler: [random, {name: stratified, strata: 16}]
zip: [{precision: [float32, float64], resolution: [[8, 8], [16, 12]]}]
exclude: [{engine: numpy, threads: {ge: 2}}]
include: [{scene: cornell_box, engine: embree, accelerator: embree}]
extend: [{where: {engine: numba}, set: {precision: float32}}]
budget: {max_time: 20s, max_spp: 1024, timeout: 5m}
checkpoints: {ratio: 1.4142, start: 1}
repeats: 3
order: {policy: blocks, seed: 1}
reference: {engine: numba, spp: 128, seed: 9000}
quality: {metric: relmse, epsilon: 1e-2, targets: [1.0e-1, 1e-2, 0.001]}
images: last
control: true
"""
TREE = yaml.safe_load(FULL)
WRONG = [math.nan, -math.inf, -1, 0, 2**70, 1.5, True, None, "", "x", "1e400s", "\x07", "numba", [], [[]], {}, {"x": {"y": 1}},
         {"name": "grid", "name2": 1}, [1, [2, {"a": 3}]], "9" * 400, "*.yaml", "../../etc/passwd", "a:b"]  # fmt: skip


def reads_or_refuses(text, overrides=()):
    """The message of the refusal, or None."""
    start, problem = time.perf_counter(), None
    try:
        root = parse_yaml(text, "a.yaml", ConfigError)
        for given_override in overrides:
            root = config.override(root, given_override)
        config.parse(root, ROOT)
    except ConfigError as error:
        problem = str(error)
        assert "\n" not in problem and len(problem) < 2000
    assert time.perf_counter() - start < 60
    return problem


def _places(data, path=()):
    children = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    found = [path] if path else []
    return found + [place for key, child in children for place in _places(child, (*path, key))]


PLACES = _places(TREE)


def test_the_file_that_is_mutated_is_right():
    assert reads_or_refuses(FULL) is None


@settings(max_examples=120)
@given(st.sampled_from(PLACES), st.sampled_from(WRONG), st.booleans(), st.booleans())
def test_a_value_or_key_put_wrong_is_read_or_refused(path, wrong, rename, drop):
    mutated = copy.deepcopy(TREE)
    parent = mutated
    for step in path[:-1]:
        parent = parent[step]
    if not isinstance(parent, dict) or not (rename or drop):
        parent[path[-1]] = wrong
    else:
        kept = parent.pop(path[-1])
        if rename:
            parent[f"{path[-1]}x"] = kept
    problem = reads_or_refuses(yaml.safe_dump(mutated, sort_keys=False))
    if rename and isinstance(parent, dict):
        assert problem is not None


@settings(max_examples=80)
@given(st.data())
def test_flipped_and_missing_bytes_are_read_or_refused(tmp_path_factory, data):
    content = bytearray(FULL.encode())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content)))]
    file = tmp_path_factory.mktemp("flipped") / "a.yaml"
    file.write_bytes(content)
    start = time.perf_counter()
    try:
        config.parse(read_yaml(file, ConfigError), ROOT)
    except ConfigError as problem:
        assert "\n" not in str(problem)
    assert time.perf_counter() - start < 60


@settings(max_examples=60)
@given(
    st.text(max_size=30),
    st.sampled_from(["", "budget.", "matrix.engine", "=", "repeats=", "a.b.c=", "quality.targets="]),
)
def test_any_override_is_read_or_refused(text, head):
    reads_or_refuses(FULL, [head + text])
