"""The tables of the dissertation's mistakes and of what is held by what name only tests and cases that exist."""

import re
from pathlib import Path

import pytest

from harness.verify import CASES

ROOT = Path(__file__).resolve().parents[2]
DISSERTATION, ACCURACY = ((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("dissertation", "accuracy"))
BOTH = pytest.mark.parametrize("text", [DISSERTATION, ACCURACY], ids=["dissertation", "accuracy"])


def cases_named(text):
    return {name.strip() for group in re.findall(r"verify ([\w., /]+?)(?:;| \|)", text) for name in group.split(",")}


@BOTH
def test_every_named_test_exists(text):
    named = re.findall(r"`([\w/]+\.py)::(\w+)`", text)
    assert len(named) > 10
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file} has no {name}"


@BOTH
def test_every_named_case_exists(text):
    ids = {case.id for case in CASES}
    assert len(cases_named(text)) > 30 and cases_named(text) <= ids, cases_named(text) - ids


def rows(text):
    """(name, rest of its row) of all tables."""
    return re.findall(r"^\| ([^|]+?) \| (.+) \|$", text.replace("| | ", "| - | "), re.M)


def test_every_item_of_the_catalogue_is_held_by_something():
    held = {name: rest for name, rest in rows(ACCURACY) if name not in ("-", "---")}
    numbered = {
        "S": (1, 3, 4, 5, 6, 7, 8, 9, 10),
        "T": (1, 2, 4, 5, 6, 7, 8, *range(10, 16), 17),
        "A": range(1, 7),
        "L": (1, 2, 3),
        "D": (1, 2, 3, 4, 5, 6, 9),
    }
    items = {f"{letter}{k}" for letter, numbers in numbered.items() for k in numbers} | set("abcdefghijklm")
    assert items <= set(held)
    for name, rest in held.items():
        assert re.search(r"verify \w|`[\w/]+\.py::\w+`", rest), f"{name} is held by nothing"


def test_every_case_has_its_place_in_the_table_of_what_is_held():
    missing = {case.id for case in CASES} - cases_named(ACCURACY)
    assert not missing


MISTAKES = re.findall(r"^\| ([\w ,]+) \| (.+?) \| (.+?) \| (.+?) \|$", DISSERTATION.partition("## Other")[0], re.M)[1:]


def test_every_mistake_has_a_row_with_what_stands_there_what_is_right_and_what_shows_it():
    assert len(MISTAKES) >= 20
    for name, written, right, shown in MISTAKES:
        assert len(written) > 20 and right, name
        assert re.search(r"verify \w|`[\w/]+\.py::\w+`", shown), f"{name} is shown by nothing"
