"""Experiment files that somebody got wrong: a reading or a ConfigError of one line, and never long in coming."""

from __future__ import annotations

import copy
import math
import re
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from engines.errors import ConfigError
from engines.schema.yaml_file import parse_yaml
from harness import config
from tests.fuzz.configs import FULL, TREE
from tests.fuzz.mutate import WRONG, parent_of, places

ROOT = Path(__file__).resolve().parent.parent.parent
PLACES = places(TREE)
VALIDATOR = Draft202012Validator(config.experiment_schema())


def reads_or_refuses(text, overrides=()):
    """The message of the refusal, or None; what is read fits the schema."""
    start, problem = time.process_time(), None
    try:
        root = parse_yaml(text, "a.yaml", ConfigError)
        for given_override in overrides:
            root = config.override(root, given_override)
        config.parse(root, ROOT)
        assert list(VALIDATOR.iter_errors(root.plain())) == []
    except ConfigError as error:
        problem = str(error)
        assert "\n" not in problem and len(problem) < 2000
    assert time.process_time() - start < 60
    return problem


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


@settings(max_examples=60)
@given(st.text(max_size=30), st.sampled_from(["", "budget.", "matrix.engine", "=", "repeats=", "a.b.c=", "quality.targets="]))
def test_any_override_is_read_or_refused(text, head):
    reads_or_refuses(FULL, [head + text])


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 10**400])
def test_a_number_that_is_not_finite_or_too_large_is_refused_with_file_and_line(number):
    """Titles and conditions of rules aside, where it is text, and matches nothing."""
    places_of_numbers = [path for path in PLACES if path != ("name",) and path[0] not in ("exclude", "extend")]
    extra = [] if number == 10**400 else [("accelerator", "leaf"), ("shader", "sizes"), ("sampler", "x")]
    for path in [*places_of_numbers, *extra]:
        tree = copy.deepcopy(TREE)
        if path in extra:
            tree["matrix"].pop(path[0])
            tree[path[0]] = {"name": "plugin:plugin", path[1]: [{"x": number}]}
        else:
            parent_of(tree, path)[path[-1]] = number
        problem = reads_or_refuses(yaml.safe_dump(tree, sort_keys=False))
        assert problem is not None and re.match(r"a\.yaml:\d+[: ]", problem), (path, problem)
