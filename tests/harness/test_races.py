"""Races in results of known truth: who is compared with whom, with what persistent spread, and who may not be ranked."""

import math
import re

import numpy as np
import pandas as pd
import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.analysis.comparisons import PAIRS, comparisons
from harness.analysis.crossings import crossings, times_to_quality
from harness.analysis.frames import ResultFrames
from harness.report.plots import Palette
from harness.report.plots.bars import quality_bars
from harness.report.plots.panels import panels
from harness.report.tables import all_tables
from harness.report.tables.evidence import evidence
from harness.report.winners import tally, winners
from tests.harness.synthetic import SMALL, arranged, base_cell, metrics

TARGETS = [0.1, 0.01]
SPP = [2**k for k in range(8)]
TWIN = "A/A"


def contestant(
    seconds,
    *,
    scene="hall",
    engine="numba",
    accelerator="bvh",
    sampler="random",
    threads=1,
    precision="float64",
    label=None,
    blocks=5,
    noise=0.01,
    level=0.5,
    change=None,
):
    """Cells of `seconds` a sample; their error is level / spp, the same for all of a block."""
    rng = np.random.default_rng([len(engine), len(accelerator), threads, bool(label)])
    made = []
    for block in range(blocks):
        cell = base_cell((scene, engine, accelerator, sampler, threads, label), block, SMALL) | {"precision": precision}
        cell["cell_id"] += precision
        own = seconds * (1 + 0.1 * block) * math.exp(rng.normal(0, noise))
        errors = [metrics(level / n * (1 + 0.03 * block)) for n in SPP]
        cell["points"] = [
            {"spp": n, "seconds": n * own, "rays": n, "metrics": found, "image": None}
            for n, found in zip(SPP, errors, strict=True)
        ]
        cell["reference_id"] = None
        made.append(cell if change is None else change(cell) or cell)
    return made


def results(tmp_path, *contestants, config=None):
    events = [{"event": "targets", "metric": "relmse_e0.01", "targets": TARGETS}, *(c for made in contestants for c in made)]
    return arranged(tmp_path, events, config)


def verdicts(found, target=0.01, scene="hall"):
    """The rows of the scene and target, by contestant."""
    rows = ResultFrames(found).verdicts
    return rows[(rows.target == target) & (rows.scene == scene)].set_index("contestant")


def twins(seconds=0.01, **more):
    return [*contestant(seconds, **more), *contestant(seconds, label=TWIN, **more)]


# Baselines


def compared(found):
    """Contestant -> its baseline and in what the two differ, of those that have one."""
    return {name: (row.baseline, row.factor) for name, row in found.dropna(subset=["baseline"]).iterrows()}


def test_all_of_a_race_are_compared_with_one_baseline_and_their_differences_named(tmp_path):
    found = verdicts(
        results(
            tmp_path,
            contestant(0.2, engine="numpy"),
            twins(),
            contestant(0.005, threads=2, precision="float32"),
            contestant(0.02, engine="embree", accelerator="embree"),
        )
    )
    first = "numpy float64 1 thread"
    assert compared(found) == {
        "numba float64 1 thread": (first, "engine"),
        "numba float32 2 threads": (first, "engine and precision and threads"),
        "embree float64 1 thread": (first, "engine"),
        "numba float64 1 thread A/A": ("numba float64 1 thread", "A/A"),
    }
    assert found.loc["numba float64 1 thread"].ratio == pytest.approx(20, rel=0.05)
    assert found.loc["numba float64 1 thread"].verdict == "faster"
    assert found.loc[first].verdict == "" and found.loc[first].no_ratio == "the baseline of its race"


@pytest.mark.parametrize(
    ("baseline", "named"),
    [
        ("numba", "numba random float32 2 threads"),
        ({"sampler": "sobol"}, "numba sobol float64 1 thread"),
        ({"engine": "numba", "threads": {"ge": 2}, "precision": ["float32"]}, "numba random float32 2 threads"),
        ({"sampler": {"name": "r*"}, "engine": "embree"}, "embree random float64 1 thread"),
        ({"sampler": "halton"}, "numpy random float64 1 thread"),
    ],
    ids=str,
)
def test_a_baseline_is_a_filter_over_any_settings(tmp_path, baseline, named):
    """Where it matches none of the race, the baseline is the one without it."""
    made = (
        *(contestant(0.2, engine="numpy"), twins(), contestant(0.01, engine="embree", accelerator="embree")),
        *(contestant(0.02, sampler="sobol"), contestant(0.005, threads=2, precision="float32")),
    )
    found = verdicts(results(tmp_path, *made, config={"baseline": baseline}))
    assert {row.baseline for _, row in found[found.label == ""].dropna(subset=["baseline"]).iterrows()} == {named}


def by_light(name, seconds):
    """A contestant that chooses lights so; all race towards one reference."""

    def chosen(cell):
        cell["shader"] = {"name": "path_tracer", "max_depth": 6, "light_sampler": name}
        cell["cell_id"] += name
        cell["raced"] = {"name": "path_tracer", "max_depth": 6}

    return contestant(seconds, change=chosen)


def test_options_of_choices_are_settings(tmp_path):
    made = by_light("uniform", 0.04), by_light("power", 0.02), by_light("bvh", 0.01)
    chosen = {"shader": {"name": "path_tracer", "light_sampler": "bvh"}}
    found = verdicts(results(tmp_path, *made, config={"baseline": chosen}))
    assert set(compared(found).values()) == {("numba light_sampler=bvh", "light_sampler")}
    assert found.ratio.min() == pytest.approx(0.25, rel=0.05)


def test_the_first_value_as_written_of_every_axis_is_the_baseline(tmp_path):
    made = contestant(0.01, sampler="halton"), contestant(0.02, sampler="sobol"), twins()
    for first, second in (("halton", "sobol"), ("sobol", "halton")):
        same = {"scene": "cornell_box", "engine": "numba"}
        written = [{**same, "sampler": {"name": name}} for name in (first, second, "random")]
        found = verdicts(results(tmp_path, *made, config={"include": written}))
        other, root = found.loc[f"numba {second}"], found.loc[f"numba {first}"]
        assert (other.baseline, other.factor) == (f"numba {first}", "sampler") and other.verdict in ("faster", "slower")
        assert other.ratio == pytest.approx(2.0 if first == "sobol" else 0.5, rel=0.05)
        assert root.verdict == "" and root.no_ratio == "the baseline of its race"


def test_every_contestant_has_a_ratio_or_a_reason(tmp_path):
    lonely = verdicts(results(tmp_path, contestant(0.01)))
    assert lonely.no_ratio.tolist() == ["alone in its race"]
    made = contestant(0.2, engine="numpy"), contestant(0.01, threads=2), contestant(0.02, sampler="sobol"), twins()
    found = verdicts(results(tmp_path, *made))
    assert ((found.no_ratio == "") == found.ratio.notna()).all() and (found.no_ratio != "").sum() == 1


def test_an_accelerator_that_both_engines_have_is_a_setting_of_its_own(tmp_path):
    made = contestant(0.2, engine="numpy"), contestant(0.01), contestant(0.02, accelerator="grid")
    grid, tree = (verdicts(results(tmp_path, *made)).loc[f"numba {name}"] for name in ("grid", "bvh"))
    assert (grid.factor, tree.factor) == ("engine and accelerator", "engine")
    both = twins(), contestant(0.02, accelerator="grid"), contestant(0.02, engine="embree", accelerator="embree")
    found = verdicts(results(tmp_path, *both))
    assert found.loc["embree"].factor == "engine", "embree has one accelerator alone, which numba lacks"


@pytest.mark.parametrize("pairs", [3, [3], [{}], [{"contestant": {}, "baseline": 2}], [{"contestant": {"engine": "numba"}}]])
def test_pairs_that_are_none_are_refused_with_their_place(tmp_path, pairs):
    with pytest.raises(ConfigError, match=r"^manifest.json config\.pairs"):
        results(tmp_path, twins(), config={"pairs": pairs})


def test_auto_of_two_engines_is_one_setting_whatever_its_options(tmp_path):
    made = contestant(0.01, engine="embree", accelerator="auto"), contestant(0.2, engine="numba", accelerator="auto")
    for cell in made[0]:
        cell["accelerator"] = {"name": "auto", "quality": "medium"}
    found = verdicts(results(tmp_path, *made))
    assert (found.loc["embree"].baseline, found.loc["embree"].factor) == ("numba", "engine")


# Persistent spread


def test_the_spread_is_that_of_all_twins_of_the_run_and_the_same_in_every_scene(tmp_path):
    """The twin of the hall is the same as its original, that of the yard takes 10 % longer in every block."""
    made = [contestant(0.2, engine="numpy", scene=scene) for scene in ("hall", "yard", "lake")]
    made += [contestant(0.01, scene="yard", noise=0), contestant(0.011, scene="yard", label=TWIN, noise=0)]
    found = results(tmp_path, *made, twins(noise=0), contestant(0.01, scene="lake"))
    expected = math.expm1(math.log(1.1) / math.sqrt(2))
    for scene in ("hall", "yard", "lake"):
        rows = verdicts(found, scene=scene)
        assert rows.persistent_spread.to_numpy() == pytest.approx(expected, rel=0.05) and (rows.twins == 2).all()
        assert rows.loc["numba"].verdict == "faster"
    words = evidence(analyse(found))
    assert "5 blocks." in words and "Persistent spread: 7 % (2 twins); fewer than 4 twins tell little of it." in words


def test_a_run_without_twins_gives_ratios_and_no_verdicts(tmp_path):
    found = results(tmp_path, contestant(0.2, engine="numpy"), contestant(0.01), contestant(0.01, engine="embree"))
    rows = verdicts(found)
    assert rows.persistent_spread.isna().all() and (rows.twins == 0).all() and rows.possible_winner.all()
    assert rows.loc["numba"].verdict == "unresolved" and rows.loc["numba"].ratio == pytest.approx(20, rel=0.05)
    assert "Persistent spread: not measured; without A/A twins nothing is called faster" in evidence(analyse(found))


def test_machines_have_spreads_of_their_own(tmp_path):
    """Twins of one machine differ by 20 %, those of the other do not."""

    def elsewhere(cell):
        cell["env_id"] = "other" + cell["env_id"]
        cell["cell_id"] += "-other"

    here = contestant(0.01, noise=0), contestant(0.012, noise=0, label=TWIN)
    found = analyse(results(tmp_path, *here, twins(noise=0.001, change=elsewhere)))
    shares = {v.contestant.settings.machine: found.spread(v.contestant).share for v in found.verdicts}
    assert sorted(shares.values()) == pytest.approx([0, 0.2], abs=0.01)
    assert evidence(found).count("Persistent spread on ") == 2


def test_a_lead_that_twins_show_too_is_unresolved(tmp_path):
    """A fifth faster in every block, where twins of equal settings differ by as much; twice as fast is none the less seen."""
    made = [contestant(0.012, engine="numpy", noise=0.001), contestant(0.01, noise=0.001)]
    for at, apart in enumerate((1.2, 1.1, 0.85, 0.95)):
        made.append(contestant(0.01 * apart, noise=0.001, label=f"{TWIN}{at}"))
    found = results(tmp_path, *made, contestant(0.002, engine="embree", noise=0.001))
    rows = verdicts(found)
    assert rows.loc["numba"].verdict == "unresolved" and rows.loc["embree"].verdict == "faster"
    assert rows.loc["numba"].ratio_low < 1.0 < rows.loc["numba"].ratio_high < 2.0


# Targets and pairs of one's own


def test_times_to_other_targets_are_found_in_the_frames(tmp_path):
    """The error is 0.5 / spp, and 3 % more in every further block, where a sample takes 10 % longer."""
    opened = ResultFrames(results(tmp_path, twins(noise=0, blocks=3)))
    found = crossings(opened.points, opened.cells, {0.03: 0.03})
    own = found[found.own & (found.measure == "time to 0.03") & (found.contestant == "numba")]
    expected = [0.01 * (1 + 0.1 * block) * 0.5 * (1 + 0.03 * block) / 0.03 for block in range(3)]
    assert own.high.tolist() == own.low.tolist() == pytest.approx(expected)
    times = times_to_quality(found).set_index(["contestant", "start"])
    assert times.loc[("numba", "warm")].seconds == pytest.approx(math.prod(expected) ** (1 / 3))


def test_contestants_are_compared_in_any_pairs(tmp_path):
    """Along the axis of samplers, against the one that is written last; all curves are read alike."""

    def alike(cell):
        cell["smooth_sampler"] = False

    analysis = analyse(
        results(tmp_path, twins(change=alike), contestant(0.02, sampler="sobol"), contestant(0.005, sampler="halton"))
    )
    rows = [(0, "hall", f"numba {name}", "numba sobol", "sampler", "", True) for name in ("random", "halton")]
    asked = pd.DataFrame([*rows, (0, "hall", "numba sobol", "", "", "the baseline", True)], columns=PAIRS)
    found = comparisons(analysis.crossings, asked, analysis.spreads, 0.05)
    assert found.measure.tolist() == [m for m in ("seconds per sample", "time to 0.1", "time to 0.01") for _ in range(3)]
    for measure, rows in found.groupby("measure"):
        each = rows.set_index("contestant")
        assert each.loc["numba random"].ratio == pytest.approx(2, rel=0.05), measure
        assert each.loc["numba halton"].ratio == pytest.approx(4, rel=0.05), measure
        assert each.verdict.to_dict() == {"numba random": "faster", "numba halton": "faster", "numba sobol": ""}
        assert each.possible_winner.to_dict() == {"numba random": False, "numba halton": True, "numba sobol": False}


# Evidence


@pytest.mark.parametrize(("blocks", "verdict"), [(1, "unresolved"), (2, "unresolved"), (3, "faster")])
def test_no_verdict_below_three_blocks(tmp_path, blocks, verdict):
    found = results(tmp_path, contestant(0.2, engine="numpy", blocks=blocks), twins(blocks=blocks))
    rows = verdicts(found)
    assert rows.loc["numba"].verdict == verdict and rows.loc["numpy"].possible_winner == (blocks < 3)
    assert ("below 3 no verdict is given" in evidence(analyse(found))) == (blocks < 3)


@pytest.mark.parametrize(
    ("contended", "words"),
    [
        ([], "Contention was not measured."),
        ([False, False], "No timing is contended."),
        ([True, False], "1 of 2 timings is contended."),
        ([True, True, False], "2 of 3 timings are contended."),
    ],
)
def test_the_first_lines_say_how_many_timings_were_contended(tmp_path, contended, words):
    cells = [*contestant(0.2, engine="numpy"), *twins()]
    for index, cell in enumerate(cells):
        cell["machine"] = {"contended": contended[index]} if index < len(contended) else {}
    assert words in evidence(analyse(results(tmp_path, cells)))


@pytest.mark.parametrize(("blocks", "dots"), [(2, 2), (3, 1)])
def test_below_three_blocks_each_is_drawn_as_a_dot(tmp_path, blocks, dots):
    """Warm and cold, for two contestants; from three blocks on a dot is a mean, and has a whisker."""
    analysis = analyse(results(tmp_path, contestant(0.2, engine="numpy", blocks=blocks), twins(blocks=blocks)))
    chart = quality_bars(analysis, panels(analysis)[0], Palette(analysis.results))
    drawn = [series for series in chart.subplots[0].content if series.look.marker == "o"]
    assert [series.y.tolist().count(row) for series in drawn for row in dict.fromkeys(series.y)] == [dots] * 4
    whiskers = [low for series in drawn for low, _ in series.x_interval if math.isfinite(low)]
    assert len(whiskers) == (4 if dots == 1 else 0)


def test_the_same_is_said_where_it_is_known(tmp_path):
    made = contestant(0.01, engine="numpy", noise=0.001), twins(noise=0.001)
    assert verdicts(results(tmp_path, *made)).loc["numba"].verdict == "same"
    assert verdicts(results(tmp_path, *made, config={"same_within": 0.001})).loc["numba"].verdict == "unresolved"


def test_a_failed_cell_counts_as_not_reached_and_keeps_its_place(tmp_path):
    def crash(cell):
        if cell["block"] == 2:
            cell |= {"state": "failed", "message": "out of rods", "points": cell["points"][:2]}

    rows = verdicts(results(tmp_path, contestant(0.01, engine="numpy", change=crash), twins(0.02)))
    broken, whole = rows.loc["numpy"], rows.loc["numba"]
    assert (broken.reached, broken.seeds, broken.failed_cells) == (4, 5, 1)
    assert broken.seconds == math.inf and 0 < broken.seconds_low < 0.5 and broken.seconds_high == math.inf
    assert whole.verdict == "unresolved" and whole.ratio == math.inf, "the baseline's time is only bounded from below"
    assert rows.loc[["numpy", "numba"]].possible_winner.all()


def test_a_time_before_the_first_checkpoint_is_an_upper_bound(tmp_path):
    made = contestant(0.2, engine="numpy", level=0.05), twins(level=0.05)
    rows = verdicts(results(tmp_path, *made), target=0.1)
    assert (rows.seconds_low == 0).all() and (rows.seconds <= rows.seconds_high).all()
    table = next(table for table in all_tables(analyse(results(tmp_path, *made))) if table.name == "time_to_quality")
    assert all(row["warm_seconds"].low == 0 for row in table.rows if row["target"] == 0.1)
    assert rows.loc["numba"].verdict == "unresolved"


# Rankings


def bright(cell):
    """Thirty times too fast, for its samples are NaN."""
    cell["counters"] = {"bad_samples": 7.0}


@pytest.mark.parametrize("flagged", ["numba", "numpy"])
def test_no_ranking_contains_a_flagged_contestant(tmp_path, flagged):
    made = [
        contestant(0.2, engine="numpy", change=bright if flagged == "numpy" else None),
        contestant(0.001, change=bright if flagged == "numba" else None),
        twins(engine="embree"),
    ]
    found = results(tmp_path, *made)
    rows = verdicts(found)
    assert rows.loc[flagged, "flags"] == "bad_samples" and not rows.loc[flagged, "possible_winner"]
    assert math.isnan(rows.loc["numba"].ratio) and rows.loc["numba"].verdict == "", "nothing was compared"
    analysis = analyse(found)
    tables = {table.name: table for table in all_tables(analysis)}
    for row in tables["speedups"].rows:
        assert flagged not in (row["contestant"], row["baseline"])
    (line,) = [line for line in winners(analysis) if line.target == 0.01]
    assert line.text.endswith(f"; flagged, so not ranked: {flagged} (bad samples)")
    assert line.first == ("embree" if flagged == "numba" else "numba"), "of those that are left"


def test_a_contestant_whose_only_rival_is_flagged_is_not_called_first(tmp_path):
    (found,) = (
        line
        for line in winners(analyse(results(tmp_path, twins(), contestant(0.001, engine="embree", change=bright))))
        if line.target == 0.01
    )
    assert found.text.startswith("numba is the only one ranked and took ") and found.rivals == 0
    assert tally([found]) == ""


def test_a_contended_contestant_is_ranked_and_warned_of(tmp_path):
    def busy(cell):
        cell["machine"] = {"contended": True}

    rows = verdicts(results(tmp_path, contestant(0.2, engine="numpy"), twins(change=busy)))
    assert rows.loc["numba"].verdict == "faster" and rows.loc["numba", "flags"] == "contended"
    assert rows.loc["numba"].possible_winner


def test_a_sentence_names_one_winner_and_how_far_it_is_ahead_or_all_that_may_be_it(tmp_path):
    made = contestant(0.2, engine="numpy"), twins(noise=0.03)
    clear = results(tmp_path, *made, contestant(0.03, engine="embree", noise=0.03))
    close = results(tmp_path, *made, contestant(0.0101, engine="embree", noise=0.03))
    (first,), (second,) = ([line for line in winners(analyse(found)) if line.target == 0.01] for found in (clear, close))
    assert (first.first, first.rivals) == ("numba", 2)
    told = (
        r"numba is first, after (.+) s \[.*\]; the next is embree, after ([\d.]+) s; numpy takes ([\d.]+) \[.*\] times as long"
    )
    ahead = re.fullmatch(told, first.text)
    assert ahead and float(ahead[2]) == pytest.approx(3 * float(ahead[1]), rel=0.1), first.text
    assert float(ahead[3]) == pytest.approx(20, rel=0.1), "paired with the baseline, which numpy is"
    assert second.first == "" and re.fullmatch(r"not separated \(2\): \w+ \(.* s\), \w+ \(.* s\)", second.text)
    counted = [first, second, first._replace(first="embree"), first, first._replace(rivals=0)]
    assert tally(counted) == (
        "Of 4 races to a target numba is first in 2, embree is first in 1; in 1 no contestant alone is first."
    )


@pytest.mark.parametrize(
    ("seconds", "spread", "verdict"), [(0.01, 3, "unresolved"), (0.001, 8, "faster"), (0.0095, 8, "unresolved")]
)
def test_a_time_that_the_references_noise_may_have_moved_is_known_less_well(tmp_path, seconds, spread, verdict):
    """At the second target alone the error stands `spread` of its standard errors above zero; at 3 nothing is known."""

    def noisy(cell):
        for point in cell["points"]:
            error = point["metrics"]["relmse_e0.01_corrected"]
            point["metrics"]["relmse_e0.01_se"] = error / (spread if error < 0.05 else 50)

    found = results(tmp_path, twins(0.01, engine="numpy", noise=0.001), contestant(seconds, noise=0.001, change=noisy))
    easy, hard = verdicts(found, 0.1), verdicts(found, 0.01)
    assert easy.loc["numba", "flags"] == "" and hard.loc["numba", "flags"] == "noisy_reference"
    assert hard.loc["numba"].verdict == verdict and hard.loc["numba"].possible_winner
    assert hard.loc["numpy"].possible_winner == (verdict == "unresolved")


def test_samplers_of_different_kinds_are_separated_only_under_both_readings(tmp_path):
    """One curve, read at a line between checkpoints and at the next checkpoint: that alone is a factor of 1.2."""

    def smooth(cell):
        cell["smooth_sampler"] = True

    made = [*twins(noise=0.001, change=smooth), *contestant(0.01, sampler="sobol", noise=0.001)]
    rows = verdicts(results(tmp_path, contestant(0.2, engine="numpy", sampler="sobol"), made))
    ratio = rows.loc["numba random"].seconds / rows.loc["numba sobol"].seconds
    assert ratio < 0.85 and rows.loc[["numba random", "numba sobol"]].possible_winner.all()
    half = [*twins(0.002, noise=0.001, change=smooth), *contestant(0.01, sampler="sobol", noise=0.001)]
    rows = verdicts(results(tmp_path, half))
    assert rows.loc["numba random"].possible_winner and not rows.loc["numba sobol"].possible_winner
