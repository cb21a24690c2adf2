"""The README's figures are those of `results/renderers`. A failure shows the rows that belong there."""

import math
import re

import pytest

import harness
from harness.report.tables.model import number_text
from tests.docs.blocks import ROOT
from tests.docs.pages import TEXT

README = TEXT["README.md"]
CONTESTANTS = ("numba sobol", "embree sobol", "mitsuba embree multijitter", "luxcore random", "cycles sobol")
TARGET = 0.01


@pytest.fixture(scope="module")
def verdicts():
    found = harness.open_results(ROOT / "results" / "renderers").verdicts
    found = found[(found.target == TARGET) & found.contestant.isin(CONTESTANTS)]
    return found.set_index(["scene", "contestant"])


def entry(verdicts, scene, contestant):
    """Seconds, bold if it may be the fastest, with a star if it is not ranked."""
    if (scene, contestant) not in verdicts.index:
        return "-"
    row = verdicts.loc[(scene, contestant)]
    reached = math.isfinite(row.seconds)
    text = number_text(row.seconds) if reached else "not reached"
    star = r"\*" if "not ranked" in (row.no_ratio or "") else ""
    return f"**{text}**" if row.possible_winner and reached else text + star


def test_the_table_of_the_readme_is_that_of_the_archive(verdicts):
    scenes = dict.fromkeys(verdicts.index.get_level_values("scene"))
    rows = [f"| `{scene}` | {' | '.join(entry(verdicts, scene, each) for each in CONTESTANTS)} |" for scene in scenes]
    shown = re.findall(r"^\| `\w+` \|.*\|$", README, re.MULTILINE)
    assert "\n".join(shown) == "\n".join(rows)


def test_the_readme_says_how_far_the_intervals_reach(verdicts):
    reached = verdicts[verdicts.seconds < math.inf]
    ends = [(reached.seconds_high / reached.seconds - 1).max(), (1 - reached.seconds_low / reached.seconds).max()]
    assert f"at most {math.ceil(100 * max(ends))} %" in " ".join(README.split())
