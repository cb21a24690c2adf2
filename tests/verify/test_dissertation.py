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


def test_every_mistake_of_the_text_has_a_row():
    assert [row for row in re.findall(r"^\| T(\d+) ", TEXT, re.M)] == [str(k) for k in range(1, 24)]
