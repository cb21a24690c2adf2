"""Closed and open division: how a config says it, that it costs no measurement, and that no ranking mixes them."""

import math

import pytest

from engines.errors import ConfigError, RaybenchError
from harness import config, store
from harness.analysis import analyse
from harness.plan import planner
from harness.report.plots.panels import facets
from harness.report.tables import all_tables
from harness.report.winners import winners
from harness.store.events import line_of
from tests.harness import sweeping
from tests.harness.test_races import contestant, results, twins, verdicts

OPEN = "extend: [{where: {engine: 'fake_engines:Other'}, set: {division: open}}]\n"


def planned(tmp_path, more="", text=sweeping.EXPERIMENT):
    return planner.make(config.load(sweeping.write(tmp_path, text + more)), allow_imports=True)


def in_open(cell):
    cell["division"] = "open"


def too_good(cell):
    """An error that falls twice as far at equal samples: another estimator."""
    in_open(cell)
    for point in cell["points"]:
        point["metrics"] = {name: value / 2 for name, value in point["metrics"].items()}


def bad(cell):
    in_open(cell)
    cell["counters"] = {"bad_samples": 1}


# In a config


@pytest.mark.parametrize(
    "more, found",
    [
        ("", {"steady": "closed", "other": "closed"}),
        ("division: open\n", {"steady": "open", "other": "open"}),
        (OPEN, {"steady": "closed", "other": "open"}),
        ("zip: {division: [open], sampler: [random]}\n", {"steady": "open", "other": "open"}),
        (
            "include: [{engine: 'fake_engines:Picky', division: open}]\n",
            {"steady": "closed", "other": "closed", "picky": "open"},
        ),
    ],
)
def test_a_division_stands_wherever_a_setting_does_and_changes_no_id(tmp_path, more, found):
    made = planned(tmp_path, more)
    assert {cell.engine_name: cell.division for cell in made.cells} == found
    assert {cell.cell_id for cell in planned(tmp_path).cells} <= {cell.cell_id for cell in made.cells} or "zip" in more


def test_a_contestant_is_in_one_division(tmp_path):
    both = sweeping.EXPERIMENT.replace("matrix: {", "matrix: {division: [closed, open], ")
    with pytest.raises(ConfigError, match=r"division: ball by steady is in both, closed and open: a contestant is in one"):
        planned(tmp_path, text=both)
    with pytest.raises(RaybenchError, match=r"division.*must be one of closed, open"):
        planned(tmp_path, "division: opened\n")


@pytest.mark.parametrize("key", ["max_spp: 4", "max_time: 1s", "timeout: 9s"])
def test_a_contestant_has_one_budget_in_a_scene(tmp_path, key):
    both = sweeping.EXPERIMENT.replace("matrix: {", f"matrix: {{budget: [{{}}, {{{key}}}], ")
    with pytest.raises(ConfigError, match="budget: ball by steady has several with the same settings otherwise"):
        planned(tmp_path, text=both)
    assert planned(tmp_path, f"extend: [{{where: {{engine: 'fake_engines:Other'}}, set: {{budget: {{{key}}}}}}}]\n").cells


def test_a_pair_is_within_one_division(tmp_path):
    pair = "pairs: [{contestant: {engine: other}, baseline: {engine: steady}}]\n"
    assert planned(tmp_path, pair).experiment.pairs
    with pytest.raises(ConfigError, match=r"pairs\[0\]: its sides are in different divisions, which are not compared"):
        planned(tmp_path, pair + OPEN)


def test_another_division_is_written_down_without_measuring_again(tmp_path):
    path = sweeping.write(tmp_path)
    sweeping.run(path, tmp_path / "out")
    before = store.latest_cells(store.read_events(tmp_path / "out"))
    sweeping.write(tmp_path, sweeping.EXPERIMENT + OPEN)
    outcome, _ = sweeping.run(path, tmp_path / "out")
    after = store.latest_cells(store.read_events(tmp_path / "out"))
    assert outcome.measured == 0 and before.keys() == after.keys()
    assert {event.engine: event.division for event in after.values()} == {"steady": "closed", "other": "open"}
    lines = {name: line_of(event.replaced(division=after[name].division)) for name, event in before.items()}
    assert lines == {name: line_of(event) for name, event in after.items()}


# In verdicts


def test_divisions_are_ranked_apart_and_never_compared(tmp_path):
    """The open one is fastest of all; the closed ranking has its own winner, and is corrected for its own members."""
    found = results(
        tmp_path,
        contestant(0.2, engine="numpy"),
        twins(),
        contestant(0.001, engine="embree", change=in_open),
        contestant(0.002, engine="other", change=in_open),
    )
    rows = verdicts(found)
    assert dict(rows.division) == {
        "numpy": "closed",
        "numba": "closed",
        "numba A/A": "closed",
        "embree open division": "open",
        "other open division": "open",
    }
    assert set(rows.index[rows.possible_winner]) == {"numba", "embree open division"}
    assert rows.loc["numba"].baseline == "numpy" and rows.loc["embree open division"].verdict == ""
    other = rows.loc["other open division"]
    assert other.baseline == "embree open division" and other.verdict == "slower"
    lines = {(line.scene, line.first) for line in winners(analyse(found)) if line.target == 0.01}
    assert lines == {("hall", "numba"), ("hall open division", "embree open division")}
    assert [facet.title for facet in facets(analyse(found).verdicts)] == ["closed division", "open division"]
    assert "division" in {column.name for column in all_tables(analyse(found))[0].columns}


def test_closed_alone_says_nothing_of_divisions(tmp_path):
    found = results(tmp_path, contestant(0.2, engine="numpy"), twins())
    assert {line.scene for line in winners(analyse(found))} == {"hall"}
    assert "division" not in {column.name for column in all_tables(analyse(found))[0].columns}


def test_the_open_division_allows_another_estimator_but_no_bad_image(tmp_path):
    """Closed, an error that is too good disqualifies; open, it does not. Bad samples disqualify in both."""
    closed = contestant(0.004, engine="embree", change=lambda cell: too_good(cell) or cell | {"division": "closed"})
    made = contestant(0.2, engine="numpy"), twins()
    row = verdicts(results(tmp_path, *made, closed)).loc["embree"]
    assert row["flags"] == "too_good_per_sample" and not row.possible_winner and math.isnan(row.ratio)
    row = verdicts(results(tmp_path, *made, contestant(0.004, engine="embree", change=too_good))).loc["embree open division"]
    assert row["flags"] == "too_good_per_sample" and row.possible_winner
    row = verdicts(results(tmp_path, *made, contestant(0.004, engine="embree", change=bad))).loc["embree open division"]
    assert row["flags"] == "bad_samples" and not row.possible_winner


def lower_from_two_samples_on(cell):
    """As another sequence of points may be; then, where samples are independent, the samples are another estimator's."""
    for point in cell["points"][1:]:
        point["metrics"] = {name: value / 2 for name, value in point["metrics"].items()}


@pytest.mark.parametrize(
    ("independent", "change", "flagged"),
    [(True, lower_from_two_samples_on, True), (False, lower_from_two_samples_on, False), (False, too_good, True)],
)
def test_points_that_depend_on_each_other_are_judged_by_the_first(tmp_path, independent, change, flagged):
    made = (*twins(), *contestant(0.004, engine="embree", change=lambda cell: change(cell) or cell | {"division": "closed"}))
    for cell in made:
        cell["smooth_sampler"] = independent
    found = verdicts(results(tmp_path, made)).loc["embree"]
    assert ("too_good_per_sample" in found["flags"]) == flagged


def more_samples(cell):
    """Half the error, from twice as many samples: the film counted them."""
    too_good(cell)
    for point in cell["points"]:
        point["mean_spp"] = 2.0 * point["spp"]
    return cell | {"division": "closed"}


def test_samples_beyond_those_asked_for_count(tmp_path):
    found = results(tmp_path, twins(), contestant(0.004, engine="embree", change=more_samples))
    assert verdicts(found).loc["embree"]["flags"] == ""
    samples = {each.contestant.settings.engine: each.samples_per_second.value for each in analyse(found).verdicts}
    assert samples["embree"] == pytest.approx(samples["numba"] * 2 * 0.01 / 0.004, rel=0.05)


def test_what_persists_between_twins_counts_in_both_divisions(tmp_path):
    found = verdicts(
        results(
            tmp_path,
            contestant(0.01),
            contestant(0.1, label="A/A"),
            contestant(0.2, engine="numpy", change=in_open),
            contestant(0.01, engine="embree", change=in_open),
        )
    )
    assert set(found.verdict) == {"unresolved", ""} and found.persistent_spread.nunique() == 1
    assert found.possible_winner["numpy open division"] and found.possible_winner["embree open division"]
