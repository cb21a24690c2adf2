"""Collections on one line are read at once; the tree is the one that PyYAML's scanner makes of them."""

import random
import time

import pytest
from yaml.error import MarkedYAMLError

from engines.errors import SceneError
from engines.schema import strict_yaml
from engines.schema.yaml_file import parse_yaml

CASES = [
    "a: [1, -2.5, 1e-3, .5, 0x1f, +3, [], {}, [[1], {b: c}]]",
    "- {instance: {group: tree, matrix: [[1, 0, 0, 0.5], [0, 1, 0, 2], [0, 0, 1, -3]]}}\n- [x]\n",
    "{a: {b: {c: [true, false, null, ~, .inf, -.inf, .nan, yes, on]}}}",
    "a: {b: 1}  \nc: [2] # three\nd: [3]\r\ne: [4]",
    "a: [1, 2,]\nb: {c: 1,}\nd: [x y]\ne: [x:y]\nf: {g: h:i}\nh: {i : 1, j:  2}",
    "a: [- 1]",
    "a: [1, 2\n",
    "a: [1, 2]]",
    "a: {b: 1}}",
    "a: {b}\nc: {d: }\ne: [f: 1]\ng: [,]",
    "a: {b: 1, b: 2}",
    "a: {1: b}",
    "a: {null: b}",
    "[a]: b",
    "{a: 1}: {b: 2}",
    "a: &x [1]\nb: *x",
    "a: !!str [1]",
    "a: [1] [2]",
    "a: [1]\n  b: 2",
    "a: [1]\n  [2]",
    "a: |\n  [1]\nb: 'x [1]'\nc: x [1]",
    "a: [" + "9" * 1001 + "]",
    "a: " + "[" * 70 + "]" * 70,
    "[1, 2]\n---\n[3]",
    "? [a]\n: b",
    "a: [--- , ...]",
    "a: [-]\nb: [+, ., ..]",
]


def outcome(text):
    """The tree with its count, or the refusal."""
    try:
        composer = strict_yaml.StrictComposer(text, 64)
        composer.root()
        counted = composer.nodes, composer.values
    except MarkedYAMLError:
        counted = None
    return counted, _outcome(text)


def _outcome(text):
    try:
        return _tree(parse_yaml(text, "t.yaml"))
    except SceneError as problem:
        return str(problem)


def _tree(node):
    value = node.value
    if isinstance(value, dict):
        value = {key: _tree(child) for key, child in value.items()}
    elif isinstance(value, list):
        value = [_tree(child) for child in value]
    return repr(value), node.path, node.line, node.key_line


@pytest.mark.parametrize("text", CASES)
def test_the_tree_and_the_refusals_are_those_of_the_scanner(text, monkeypatch):
    quick = outcome(text)
    monkeypatch.setattr(strict_yaml, "_flow_of", lambda line, mark: None)
    assert quick == outcome(text)


def test_random_collections_give_the_same_tree_or_refusal(monkeypatch):
    rng, quick = random.Random(4), strict_yaml._flow_of
    pieces = [
        "[",
        "]",
        "{",
        "}",
        ",",
        ", ",
        ": ",
        ":",
        " ",
        "a",
        "b1",
        "-",
        "1",
        "2.5",
        "-3",
        ".",
        "null",
        "\n",
        "- ",
        "#",
        "'",
    ]
    for _ in range(1500):
        text = "k: [" + "".join(rng.choices(pieces, k=rng.randint(1, 12))) + "]"
        monkeypatch.setattr(strict_yaml, "_flow_of", quick)
        found = outcome(text)
        monkeypatch.setattr(strict_yaml, "_flow_of", lambda line, mark: None)
        assert found == outcome(text), text


def test_the_values_of_collections_count_towards_the_limits(monkeypatch):
    monkeypatch.setattr(strict_yaml, "MAX_NODES", 20)
    parse_yaml("a: [1, 2, 3, 4, 5, 6, 7, 8, 9]\nb: [1, 2, 3, 4, 5]")
    with pytest.raises(SceneError, match="more than 20 values"):
        parse_yaml("a: [1, 2, 3, 4, 5, 6, 7, 8, 9]\nb: [1, 2, 3, 4, 5, 6, 7, 8, 9]")
    with pytest.raises(SceneError, match="aliases counted in full"):
        parse_yaml("a: &x\n  [1, 2, 3, 4, 5]\nb: [*x, *x, *x]")


def test_a_thousand_lines_of_matrices_are_read_in_a_fraction_of_a_second():
    line = "  - {instance: {group: tree, matrix: [[1, 0, 0, 0.5], [0, 1, 0, 2.25], [0, 0, 1, -3]]}}\n"
    started = time.process_time()
    parse_yaml("shapes:\n" + line * 1000)
    assert time.process_time() - started < 0.8  # 0.1 s alone; PyYAML's scanner takes 1.2 s
