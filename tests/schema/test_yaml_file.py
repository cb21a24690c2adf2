"""The YAML reader: what it means, where things are, and that hostile files end early with one clear error."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines.errors import ConfigError, SceneError
from engines.schema import strict_yaml, yaml_file
from engines.schema.yaml_file import locate, parse_yaml, read_yaml, yaml_text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E5", 1e5),
        (".5", 0.5),
        ("5.", 5.0),
        ("-7", -7),
        ("+7", 7),
        ("0x1F", 31),
        ("0o17", 15),
        ("017", 17),
        ("true", True),
        ("False", False),
        ("yes", "yes"),
        ("on", "on"),
        ("~", None),
        ("null", None),
        ("-.inf", -math.inf),
        ("2017-01-01", "2017-01-01"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("'1'", "1"),
        ("!!str 1", "1"),
        ("|\n  two\n  lines", "two\nlines"),
    ],
)
def test_plain_scalars_mean_what_yaml_1_2_says(text, value):
    found = parse_yaml(f"a: {text}").plain()["a"]
    assert found == value and type(found) is type(value)


def test_every_value_knows_its_line_and_key_path():
    root = parse_yaml("a:\n  b:\n    - 1\n    - {c: 2}\nd:\n  3\n", "f.yaml")
    node = root.at(("a", "b", 1, "c"))
    assert (node.line, node.path, node.where) == (4, ("a", "b", 1, "c"), "f.yaml:4 a.b[1].c")
    assert (root.at(("d",)).key_line, root.at(("d",)).line) == (5, 6)
    assert str(node.refuse("must be 3")) == "f.yaml:4 a.b[1].c = 2: must be 3"
    assert root.at(("a", "b", 7, "x")).path == ("a", "b")


def test_duplicate_keys_are_refused_with_both_lines():
    with pytest.raises(SceneError, match=r"^f.yaml:3: 'a' is there twice: first in line 1, again in line 3$"):
        parse_yaml("a: 1\nb: 2\na: 3\n", "f.yaml")


def test_duplicate_merge_keys_are_refused():
    with pytest.raises(SceneError, match="'<<' is there twice"):
        parse_yaml("x: &x {p: 1}\ny:\n  <<: *x\n  <<: *x\n")


def test_anchors_aliases_and_merges_work():
    text = "base: &base {a: 1, b: [1, 2]}\none: {<<: *base, b: 3}\ntwo: {<<: [{a: 5}, *base], c: 4}\nthree: *base\n"
    plain = parse_yaml(text).plain()
    assert plain["one"] == {"a": 1, "b": 3}
    assert plain["two"] == {"a": 5, "b": [1, 2], "c": 4}
    assert plain["three"] == plain["base"]


def _bomb(link):
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{i}: &a{i} " + link(f"*a{i - 1}") for i in range(1, 9)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (_bomb(lambda alias: f"[{', '.join([alias] * 9)}]"), "aliases counted in full"),
        (_bomb(lambda alias: f"{{<<: [{', '.join([alias] * 9)}]}}"), "aliases counted in full"),
        ("a: &a 1\nb: [" + "*a," * 2000 + "]", "more than 1000 aliases"),
        ("[" * 100_000, "maximum nesting depth"),  # of libyaml
        ("[" * 100, "nested deeper than 64 levels"),
        ("- " * 50_000 + "1", "nested deeper than 64 levels"),
        ("{a: " * 50_000, "nested deeper than 64 levels"),
        ("? " * 50_000, "keys are text"),
        ("\n".join(f"a{i}: &a{i} [*a{i - 1}]" if i else "a0: &a0 1" for i in range(100)), "nested deeper"),
        ("a: &a [*a]", "no finished anchor"),
        ("a: *b", "no finished anchor"),
        ("a: !!python/object/apply:os.system [ls]", "tags are not allowed"),
        ("a: !x {b: 1}", "tags are not allowed"),
        ("a: 1\n---\nb: 2", "a second document"),
        ("1: 2", "keys are text"),
        ("[a]: 2", "keys are text"),
        ("? {a: b}\n: 2", "keys are text"),
        ("a: " + "9" * 5000, "too many digits"),
        ("a: b: c", "not YAML"),
        ("\t- a", "not YAML"),
        ("a: [1, 2", "not YAML"),
        ("é: é\na: \0", "f.yaml:2: not text: character #x0000"),
        ("é: é\na: \ud800", "f.yaml:2: not text: character #xd800"),
        ("a: {<<: 3}", "<<: expected a mapping"),
        ("", "empty"),
        ("# nothing\n", "empty"),
    ],
)
def test_hostile_text_is_refused_at_once(text, message):
    start = time.process_time()  # of this process: a wall clock says little on a busy machine
    with pytest.raises(SceneError, match=message) as caught:
        parse_yaml(text, "f.yaml")
    assert time.process_time() - start < 10.0
    assert str(caught.value).startswith("f.yaml")


def test_a_document_of_too_many_values_is_refused(monkeypatch):
    monkeypatch.setattr(strict_yaml, "MAX_NODES", 100)
    with pytest.raises(SceneError, match="more than 100 values"):
        parse_yaml("[" + "1, " * 101 + "]")


def test_text_is_written_as_long_as_it_can_be_read(monkeypatch):
    tree = {"a": [1, (2, 3)], "b": {"c": "d", "e": [[1.5], None]}}
    composer = strict_yaml.StrictComposer(yaml_text(tree), 64)
    composer.root()
    monkeypatch.setattr(strict_yaml, "MAX_NODES", composer.nodes)
    assert parse_yaml(yaml_text(tree)).plain() == {"a": [1, [2, 3]], "b": tree["b"]}
    monkeypatch.setattr(strict_yaml, "MAX_NODES", composer.nodes - 1)
    with pytest.raises(ConfigError, match=f"t.yaml: {composer.nodes} values and keys, of at most {composer.nodes - 1}"):
        yaml_text(tree, "t.yaml")


def test_files_that_cannot_be_read_are_refused(tmp_path, monkeypatch):
    def refused(name, content=None):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigError) as caught:
            read_yaml(tmp_path / name, ConfigError)
        assert str(caught.value).startswith(str(tmp_path / name))
        return str(caught.value)

    assert "No such file" in refused("missing.yaml")
    assert ":1: empty" in refused("empty.yaml", b"") and ":1: empty" in refused("comment.yaml", b"# nothing\n")
    assert ":2: not UTF-8 text: byte 0xff" in refused("binary.yaml", b"a: 1\nb: \xff\xfe")
    (tmp_path / "folder.yaml").mkdir()
    assert "is not a regular file but a folder" in refused("folder.yaml")
    monkeypatch.setattr(yaml_file, "MAX_BYTES", 100)
    assert "larger than" in refused("large.yaml", b"a" * 101)


def test_byte_order_mark_and_crlf_are_accepted(tmp_path):
    (tmp_path / "dos.yaml").write_bytes(b"\xef\xbb\xbfa: 1\r\nb: [1,\r\n 2]\r\n")
    root = read_yaml(tmp_path / "dos.yaml")
    assert root.plain() == {"a": 1, "b": [1, 2]} and root.at(("b", 1)).line == 3


def test_plain_data_becomes_the_same_tree_without_lines():
    root = locate({"a": (1, {"b": 2.5})})
    assert root.plain() == {"a": [1, {"b": 2.5}]}
    assert str(root.at(("a", 1, "b")).refuse("no")) == "a[1].b = 2.5: no"
    loop: list = []
    loop.append(loop)
    with pytest.raises(SceneError, match="nested deeper"):
        locate({"a": loop})
    with pytest.raises(SceneError, match="keys are text"):
        locate({"a": {1: 2}})


@pytest.mark.parametrize("number", ["9" * 1001, "0x" + "f" * 100_000, "0o" + "7" * 5000, "9" * 100_000])
def test_numbers_of_too_many_digits_are_refused_with_the_line(number):
    with pytest.raises(SceneError, match=r"a\.yaml:2: a number with too many digits"):
        parse_yaml(f"a: 1\nb: {number}\n", "a.yaml")
    assert parse_yaml(f"a: {'9' * 400}").plain() == {"a": int("9" * 400)}


NUMBERS = st.integers(-(10**300), 10**300) | st.floats(allow_nan=False)
WORDS = [
    "1e-5",
    "1E5",
    ".5",
    "5.",
    "0o17",
    "017",
    "1_000",
    "1:30",
    "yes",
    "null",
    "~",
    "",
    "<<",
    "=",
    "- a",
    "a: b",
    "2017-1-1",
]
TEXTS = st.text() | st.sampled_from(WORDS) | st.from_regex(r"[-+0-9.eExo_:nfa~]{1,8}", fullmatch=True)
DATA = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(TEXTS, DATA, max_size=4))
def test_what_is_written_reads_as_the_same_data(data):
    text = yaml_text(data)
    assert repr(parse_yaml(text).plain()) == repr(data), text


def test_data_that_stands_in_several_places_is_written_in_each():
    shared = {"a": [1, 2]}
    text = yaml_text({"list": [shared] * 1001, "not a number": math.nan})
    assert "&" not in text
    assert parse_yaml(text).plain()["list"] == [shared] * 1001


def test_text_that_other_readers_take_for_something_else_is_in_quotes():
    assert yaml_text({"a": "yes", "b": "1e-5", "c": 1e-5}) == "{a: 'yes', b: '1e-5', c: 1.0e-05}\n"
