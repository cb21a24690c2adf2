"""A description of keys reads files, refuses with file, line and path, and makes the JSON schema of what it reads."""

from __future__ import annotations

import pytest
from jsonschema import Draft202012Validator

from engines.errors import ConfigError
from engines.schema.keys import Given, Key, Record, Tagged, Variants, by_name, list_of
from engines.schema.kinds import ANGLE, BOOLEAN, DIRECTION, NUMBER, POSITIVE, TEXT, color, integer, one_of, within
from engines.schema.yaml_file import parse_yaml


def area(given: Given, scale: float) -> float:
    if given["height"] > 10 * given["width"]:
        raise given.at("height").refuse("too high")
    return scale * given["width"] * given["height"]


BOX = Record("A box.", {"width": Key(POSITIVE, "Its width.", unit="metres"), "height": Key(POSITIVE, "Its height.", 2)}, area)
WAY = Record(
    "A way.",
    {"file": Key(TEXT, "A file.", None), "x": Key(NUMBER, "One end.", None), "y": Key(NUMBER, "The other.", None)},
    lambda given, context: given.values,
    either=(("file",), ("x", "y")),
)
PLAIN = Record(
    "All kinds.",
    {
        "count": Key(integer(1, 9), "How many.", 3),
        "switch": Key(BOOLEAN, "Whether.", False),
        "angle": Key(ANGLE, "Angle.", 45),
        "color": Key(color(1), "Colour.", 0.5),
        "side": Key(one_of(("a", "b"), "side"), "Which.", "a"),
        "share": Key(within(0, 1), "Share.", 0.25),
        "toward": Key(DIRECTION, "Where to.", (0, 0, 2)),
    },
    lambda given, context: given,
)
FILE = Record(
    "A file.",
    {
        "boxes": Key(list_of(BOX, "boxes"), "Boxes.", None),
        "named": Key(by_name(BOX, "boxes"), "Boxes by name.", None),
        "plan": Key(Tagged("plan", "type", {"box": BOX, "way": WAY}), "A plan.", None),
        "part": Key(Variants("part", {"box": BOX, "way": WAY}, {"tag": Key(TEXT, "A tag.", None)}), "A part.", None),
        "all": Key(PLAIN, "All kinds.", None),
    },
    lambda given, context: given.values,
)
VALIDATOR = Draft202012Validator(FILE.schema())


def read(text):
    return FILE.read(parse_yaml(text, "a.yaml", ConfigError), 10.0)


GOOD = {
    "boxes:\n- {width: 3}\n- {width: 1, height: 1}": ("boxes", [60.0, 10.0]),
    "boxes:": ("boxes", []),
    "named: {one: {width: 1}, two: {width: 2}}": ("named", {"one": 20.0, "two": 40.0}),
    "named:": ("named", {}),
    "plan: {type: box, width: 1}": ("plan", 20.0),
    "plan: {type: way, file: a}": ("plan", {"file": "a", "x": None, "y": None}),
    "part: {way: {x: 1, y: 2}}": ("part", {"file": None, "x": 1.0, "y": 2.0}),
    "part: {tag: a, box: {width: 1}}": ("part", 20.0),
}


@pytest.mark.parametrize(("text", "expected"), GOOD.items())
def test_what_a_file_says_is_read_and_fits_the_schema(text, expected):
    key, value = expected
    assert read(text)[key] == value
    assert list(VALIDATOR.iter_errors(parse_yaml(text).plain())) == []


WRONG = {
    "box: 1": "a.yaml:1 box: unknown key: did you mean 'boxes'? known: all, boxes, named, part, plan",
    "boxes: 3": "a.yaml:1 boxes = 3: must be a list of boxes",
    "named: [1]": "a.yaml:1 named: must be a mapping from names to boxes",
    "boxes:\n- 4": "a.yaml:2 boxes[0] = 4: must be a mapping with keys of width, height",
    "boxes:\n- {}": "a.yaml:2 boxes[0].width: is missing",
    "named:\n  a: {width: 1,\n    height: 0}": "a.yaml:3 named.a.height = 0: must be greater than 0",
    "named: {a: {width: 1, height: 11}}": "a.yaml:1 named.a.height = 11: too high",
    "named: {a: {width: 1, hight: 1}}": "a.yaml:1 named.a.hight: unknown key: did you mean 'height'? known: height, width",
    "plan: 1": "a.yaml:1 plan = 1: must be a mapping with a type and the keys of that plan",
    "plan: {width: 1}": "a.yaml:1 plan.type: is missing: known: box, way",
    "plan: {type: bex}": "a.yaml:1 plan.type = 'bex': unknown plan: did you mean 'box'? known: box, way",
    "plan: {type: [box]}": "a.yaml:1 plan.type: unknown plan: known: box, way",
    "plan: {type: box, widh: 1}": "a.yaml:1 plan.widh: unknown key: did you mean 'width'? known: height, type, width",
    "plan: {type: way}": "a.yaml:1 plan: needs file, or x and y",
    "plan: {type: way, x: 1}": "a.yaml:1 plan.y: is missing",
    "plan: {type: way, y: 1, file: a}": "a.yaml:1 plan.y: either file, or x and y",
    "part: 1": "a.yaml:1 part = 1: must be a mapping with one key, the kind of part (box, way) and tag",
    "part: {tag: a}": "a.yaml:1 part: must have one kind of part: box, way",
    "part: {box: {width: 1}, way: {file: a}}": "a.yaml:1 part: must have one kind of part: box, way",
    "part: {bx: 1}": "a.yaml:1 part.bx: unknown part: did you mean 'box'? known: box, tag, way",
    "all: {count: 10}": "a.yaml:1 all.count = 10: must be an integer in [1, 9]",
    "all: {side: c}": "a.yaml:1 all.side = 'c': unknown side: known: a, b",
    "all: {angle: 180}": "a.yaml:1 all.angle = 180: must lie in (0, 180) degrees",
    "all: {color: [0, 2, 0]}": "a.yaml:1 all.color[1] = 2: must lie in [0, 1]",
    "all: {share: -1}": "a.yaml:1 all.share = -1: must lie in [0, 1]",
    "all: {toward: [0, 0, 0]}": "a.yaml:1 all.toward: must not be the zero vector",
    "all: {switch: 1}": "a.yaml:1 all.switch = 1: must be true or false",
}
LOOSER = ("too high", "must not be the zero vector", "either file")
"""What a JSON schema cannot say, or says in another way."""


@pytest.mark.parametrize(("text", "message"), WRONG.items())
def test_what_is_wrong_is_refused_where_it_stands(text, message):
    with pytest.raises(ConfigError) as refused:
        read(text)
    assert str(refused.value) == message
    if not any(words in message for words in LOOSER):
        assert list(VALIDATOR.iter_errors(parse_yaml(text).plain())) != []


def test_defaults_are_written_as_in_a_file_and_read_like_it():
    given = read("all: {count: 4}")["all"]
    assert given.values == {
        "count": 4,
        "switch": False,
        "angle": 45.0,
        "color": (0.5, 0.5, 0.5),
        "side": "a",
        "share": 0.25,
        "toward": (0, 0, 1),
    }
    assert given.has("count") and not given.has("switch") and given.at("count").value == 4
    assert given.written == {"count": 4}
    properties = PLAIN.schema()["properties"]
    filled = {key: each["default"] for key, each in properties.items()}
    assert filled == {"count": 3, "switch": False, "angle": 45, "color": 0.5, "side": "a", "share": 0.25, "toward": [0, 0, 2]}


def test_empty_defaults_are_not_in_the_schema():
    record = Record("Empty.", {"none": Key(TEXT, "None.", None), "part": Key(Record("A part.", {}), "A part.", {})})
    assert [key for key, each in record.schema()["properties"].items() if "default" in each] == []


def test_a_default_out_of_range_is_refused_when_the_record_is_made():
    with pytest.raises(Exception, match=r"must be an integer in \[1, 9\]"):
        Record("Wrong.", {"count": Key(integer(1, 9), "How many.", 10)})


def test_meanings_and_units_are_in_the_schema():
    schema = BOX.schema()
    assert schema["description"] == "A box." and schema["required"] == ["width"] and not schema["additionalProperties"]
    assert schema["properties"]["width"] == {"type": "number", "exclusiveMinimum": 0, "description": "Its width. Unit: metres."}
    assert schema["properties"]["height"]["default"] == 2 and schema["properties"]["height"]["description"] == "Its height."


def test_other_tags_may_be_read_by_the_caller():
    plans = Tagged("plan", "type", {"box": BOX}, lambda node, named, context: (named.value, context), {"type": "object"})
    assert plans.read(parse_yaml("{type: 'a:b', any: 1}"), 7) == ("a:b", 7)
    assert plans.schema()["anyOf"][-1] == {"type": "object"}
