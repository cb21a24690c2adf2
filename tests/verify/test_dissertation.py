"""The table of the dissertation's mistakes names only tests and cases that exist."""

import re
from pathlib import Path

from harness.verify import CASES

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "dissertation.md").read_text(encoding="utf-8")


def test_every_named_test_exists():
    named = re.findall(r"`([\w/]+\.py)::(\w+)`", TEXT)
    assert len(named) > 10
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file} has no {name}"


def test_every_named_case_exists():
    ids = {case.id for case in CASES}
    named = {name.strip() for group in re.findall(r"verify ([\w., ]+?)(?:;| \|)", TEXT) for name in group.split(",")}
    assert len(named) > 30 and named <= ids, named - ids


ROWS = re.findall(r"^\| ([TM][0-9b]+|ties) \| (.+?) \| (.+?) \| (.+?) \|$", TEXT, re.M)


def test_every_mistake_has_a_row_with_what_stands_there_what_is_right_and_what_shows_it():
    expected = [f"T{k}" for k in range(1, 24)] + [f"M{k}" for k in range(1, 36)]
    expected.insert(expected.index("M7") + 1, "M7b")
    assert [row[0] for row in ROWS] == [*expected, "ties"]
    for name, written, right, shown in ROWS:
        assert len(written) > 20 and right, name
        assert re.search(r"verify \w|`[\w/]+\.py::\w+`", shown), f"{name} is shown by nothing"
