"""Ratios along each axis and of pairs, in results of known truth, and the sentences and tables that tell them."""

import math
from types import SimpleNamespace

import pytest

from harness.analysis import analyse
from harness.analysis.by_axis import OTHER_REFERENCE
from harness.report.html.axes import axis_tables
from harness.report.sentences import repeats_to_separate, sentences, sentences_text
from harness.report.tables import all_tables
from harness.report.tables.model import csv_text, latex_text, markdown_text
from harness.report.winners import winners_text
from tests.harness.test_races import by_light, contestant, results, twins

TO = "time to 0.01"


def along(analysis, axis, measure=TO):
    """(value, over, scene, settings) -> row of the axis."""
    found = analysis.by_axis
    found = found[(found.axis == axis) & (found.measure == measure)]
    return {(row.value, row.over, row.scene, row.settings): row for row in found.itertuples()}


def lines(analysis, axis):
    return [each.text for each in sentences(analysis) if each.axis == axis]


def samplers(tmp_path, noise=0.001, **more):
    """sobol is twice as fast as random on two scenes, and as fast on a third."""
    made = []
    for scene, seconds in {"hall": 0.005, "yard": 0.005, "attic": 0.01}.items():
        for engine in ("numba", "embree"):
            made += twins(0.01, scene=scene, engine=engine, noise=noise, change=patterned)
            made += contestant(seconds, scene=scene, engine=engine, sampler="sobol", noise=noise, change=patterned)
    written = [
        {"scene": "cornell_box", "engine": engine, "sampler": sampler, "accelerator": "bvh"}
        for engine in ("numba", "embree")
        for sampler in ("random", "sobol")
    ]
    return analyse(results(tmp_path, made, config={"include": written}, **more))


def patterned(cell):
    """All curves are read alike."""
    cell["smooth_sampler"] = False


def test_each_value_is_compared_with_the_first_where_all_else_is_equal(tmp_path):
    analysis = samplers(tmp_path)
    of_samplers, of_engines = along(analysis, "sampler"), along(analysis, "engine")
    places = [(scene, engine) for scene in ("hall", "yard", "attic") for engine in ("numba", "embree")]
    assert {key[2:] for key in of_samplers} == set(places) and {key[:2] for key in of_samplers} == {("sobol", "random")}
    assert {key[:2] for key in of_engines} == {("embree", "numba")} and len(of_engines) == 6
    for (_, _, scene, _), row in of_samplers.items():
        assert row.ratio == pytest.approx(1 if scene == "attic" else 2, rel=0.02)
        assert row.verdict == ("same" if scene == "attic" else "faster")
        assert "A/A" not in row.contestant + row.baseline
    assert analysis.by_axis.groupby(["axis", "measure"]).race.nunique().eq(1).all(), "one family an axis and measure"


def test_an_option_of_a_choice_is_an_axis(tmp_path):
    analysis = analyse(results(tmp_path, by_light("bvh", 0.02), by_light("power", 0.01)))
    ((key, row),) = along(analysis, "light_sampler").items()
    assert key[:2] == ("power", "bvh") and row.ratio == pytest.approx(2, rel=0.05)
    assert set(analysis.by_axis.axis) == {"light_sampler"}


def test_a_value_that_descriptions_leave_out_is_the_first_where_the_config_writes_it_first(tmp_path):
    """uniform, the default of `light_sampler`, which a result of the default does not name."""
    lights = [{"name": "path_tracer", "max_depth": 6, "light_sampler": name} for name in ("uniform", "bvh", "power")]
    config = {"include": [{"scene": "cornell_box", "engine": "numba", "shader": shader} for shader in lights]}
    made = by_light("bvh", 0.02), by_light("power", 0.01), by_light("uniform", 0.04)
    analysis = analyse(results(tmp_path, *made, config=config))
    assert {key[:2] for key in along(analysis, "light_sampler")} == {("bvh", "uniform"), ("power", "uniform")}
    assert set(analysis.comparisons.baseline) - {""} == {"numba"}


def test_an_image_is_not_compared_with_that_of_another_option_of_the_same_engine(tmp_path):
    analysis = analyse(results(tmp_path, by_light("bvh", 0.02), by_light("power", 0.01)))
    assert [verdict.image_baseline for verdict in analysis.verdicts if not verdict.contestant.settings.label] == [None, None]


def test_an_option_with_the_name_of_a_setting_is_an_axis_of_its_own(tmp_path):
    """So is one that another choice has, too."""

    def chosen(threads, samples):
        def change(cell):
            cell["accelerator"] |= {"threads": threads, "samples": 8}
            cell["sampler"] |= {"samples": samples}
            cell["cell_id"] += f"{threads}-{samples}"

        return change

    made = (
        twins(0.02, change=chosen(1, 4)),
        contestant(0.01, change=chosen(2, 4)),
        contestant(0.005, change=chosen(1, 5)),
        contestant(0.04, threads=2, change=chosen(1, 4)),
    )
    analysis = analyse(results(tmp_path, *made))
    assert set(analysis.by_axis.axis) == {"threads", "accelerator.threads", "sampler.samples"}
    for axis, values, ratio in (
        ("accelerator.threads", ("2", "1"), 2),
        ("sampler.samples", ("5", "4"), 4),
        ("threads", ("2 threads", "1 thread"), 0.5),
    ):
        ((key, row),) = along(analysis, axis).items()
        assert key[:2] == values and row.ratio == pytest.approx(ratio, rel=0.05)


def test_images_of_different_references_are_compared_by_their_samples_alone(tmp_path):
    def whitted(cell):
        cell["cell_id"] += "whitted"
        cell["shader"] = {"name": "whitted", "max_depth": 6, "ambient": 0.0}

    analysis = analyse(results(tmp_path, twins(), contestant(0.005, change=whitted)))
    (per_sample,) = along(analysis, "shader", "seconds per sample").values()
    (to_target,) = along(analysis, "shader").values()
    assert per_sample.ratio in (pytest.approx(2, rel=0.05), pytest.approx(0.5, rel=0.05))
    assert (to_target.no_ratio, to_target.verdict) == (OTHER_REFERENCE, "") and math.isnan(to_target.ratio)
    (line,) = lines(analysis, "shader")
    assert line.startswith("a sample of ") and "time on hall" in line


def test_a_pair_of_the_config_is_a_further_ratio_unless_it_is_known(tmp_path):
    made = contestant(0.2, engine="numpy"), twins(), contestant(0.005, engine="embree", threads=2, precision="float32")
    pairs = [
        {"contestant": {"engine": "embree", "threads": {"ge": 2}}, "baseline": "numba"},
        {"contestant": "numba", "baseline": "numpy"},
    ]
    analysis = analyse(results(tmp_path, *made, config={"pairs": pairs}))
    found = analysis.by_axis[(analysis.by_axis.measure == TO) & analysis.by_axis.axis.str.startswith("pair")]
    assert found.axis.tolist() == ["pair (engine and precision and threads)"]
    assert found.ratio.item() == pytest.approx(2, rel=0.05) and found.baseline.item() == "numba float64 1 thread"
    race = analysis.comparisons
    assert set(race[(race.measure == TO) & (race.no_ratio == "") & (race.factor != "A/A")].baseline) == {
        "numpy float64 1 thread"
    }


def test_a_flagged_value_has_no_ratio_and_says_so(tmp_path):
    def bad(cell):
        cell["counters"] = {"bad_samples": 3.0}

    analysis = analyse(results(tmp_path, twins(), contestant(0.005, sampler="sobol", change=bad)))
    (row,) = along(analysis, "sampler").values()
    assert row.verdict == "" and math.isnan(row.ratio) and "flagged, so not ranked" in row.no_ratio
    (line,) = lines(analysis, "sampler")
    assert "not compared" in line and "flagged, so not ranked" in line


# In words


def test_what_has_a_ratio_is_told_before_what_has_none(tmp_path):
    threes = contestant(0.005, engine="embree", threads=2), contestant(0.002, engine="numpy", threads=2)
    known = [each.known for each in sentences(analyse(results(tmp_path, twins(), *threes)))]
    assert set(known) == {True, False} and known == sorted(known, reverse=True)


def test_a_sentence_tells_each_scene_and_what_is_not_separated(tmp_path):
    (of_engine,) = lines(samplers(tmp_path), "engine")
    assert of_engine.startswith("embree reaches 0.01 ") and "numba" in of_engine and of_engine.endswith(".")
    embree = {"engine": "embree", "accelerator": "embree"}
    made = (
        twins(),
        contestant(0.005, **embree),
        twins(scene="yard", noise=0.1),
        twins(0.0104, scene="yard", noise=0.1, **embree),
    )
    (line,) = lines(analyse(results(tmp_path, *made, config={"baseline": "numba"})), "engine")
    assert line.startswith(("embree reaches 0.01 in 0.4", "embree reaches 0.01 in 0.5")), line
    assert " of numba's time on hall; not separated on yard (some " in line and line.endswith(" repeats would tell).")


@pytest.mark.parametrize(("seconds", "words"), [(0.005, "of random's time"), (0.02, "times random's time")])
def test_a_sentence_says_what_share_of_the_time_or_how_many_times_the_time(seconds, words, tmp_path):
    made = twins(0.01, noise=0.001), contestant(seconds, sampler="sobol", noise=0.001, change=patterned)
    (line,) = lines(analyse(results(tmp_path, *made)), "sampler")
    assert line.startswith("sobol reaches 0.01 in ") and f") {words} on hall" in line


def test_a_sentence_says_that_twins_are_missing_where_a_clear_ratio_is_not_decided(tmp_path):
    (line,) = lines(analyse(results(tmp_path, contestant(0.01), contestant(0.001, sampler="sobol"))), "sampler")
    assert "not separated on" in line and "without A/A twins" in line


def test_a_sentence_says_that_the_reference_is_too_noisy_instead_of_asking_for_repeats(tmp_path):
    def noisy(cell):
        for point in cell["points"]:
            point["metrics"]["relmse_e0.01_se"] = 0.25 * point["metrics"]["relmse_e0.01"]

    made = twins(0.01, noise=0.001), contestant(0.012, sampler="sobol", noise=0.001)
    (line,) = lines(analyse(results(tmp_path, *made)), "sampler")
    assert "not separated" not in line
    made = twins(0.01, noise=0.001), contestant(0.012, sampler="sobol", noise=0.001, change=noisy)
    (line,) = lines(analyse(results(tmp_path, *made)), "sampler")
    assert "not separated" in line and "the reference is too noisy" in line and "repeats" not in line


def test_a_sentence_says_who_did_not_get_there(tmp_path):
    def slow(cell):
        cell["points"] = cell["points"][:4]

    made = twins(), contestant(0.01, sampler="sobol", change=slow), twins(scene="yard")
    other = contestant(0.005, sampler="sobol", scene="yard")
    (line,) = lines(analyse(results(tmp_path, *made, other)), "sampler")
    assert "time on yard; sobol did not reach it on hall" in line


def test_a_sentence_says_what_is_known_at_an_easier_target_where_neither_reached_the_hardest(tmp_path):
    def slow(cell):
        cell["points"] = cell["points"][:4]

    on_hall = [*twins(change=slow), *contestant(0.005, sampler="sobol", change=slow)]
    on_yard = [*twins(scene="yard"), *contestant(0.005, sampler="sobol", scene="yard")]
    (line,) = lines(analyse(results(tmp_path, on_hall, on_yard)), "sampler")
    assert "time on yard; neither reached it on hall (0.1 in 0." in line and line.endswith(") on hall).")


@pytest.mark.parametrize("decided", [False, True])
def test_axes_that_vary_together_are_told_unless_they_are_those_of_two_contestants_of_whom_one_is_first(tmp_path, decided):
    """What is known of the two then stands in the winners' sentence."""
    analysis = analyse(results(tmp_path, twins(), contestant(0.005 if decided else 0.0101, engine="embree", threads=2)))
    assert analysis.by_axis.empty
    told = [line.split(" in ")[0] for line in lines(analysis, "engine and threads")]
    assert told == [] if decided else ["embree 2 threads reaches 0.01"]
    assert ("numba 1 thread takes" in winners_text(analysis)) == decided
    assert lines(analysis, "threads") == ["no ratio of threads alone: contestants that differ in it differ in engine too."]
    assert "threads: no ratio of threads alone" in sentences_text(analysis)


def test_a_comparison_that_one_scene_has_decided_and_another_has_not_is_told_of_both(tmp_path):
    made = twins(), contestant(0.005, engine="embree", threads=2)
    also = twins(scene="yard"), contestant(0.0101, engine="embree", threads=2, scene="yard", noise=0.05)
    (line,) = lines(analyse(results(tmp_path, *made, *also)), "engine and threads")
    assert " on hall" in line and "not separated on yard" in line


def test_a_ratio_is_told_once_where_the_baseline_is_not_the_first_value(tmp_path):
    made = twins(0.01, sampler="random"), contestant(0.005, sampler="sobol")
    analysis = analyse(results(tmp_path, *made, config={"baseline": {"sampler": "sobol"}}))
    assert [row.contestant for row in analysis.comparisons.itertuples() if row.baseline and row.factor != "A/A"]
    assert len(lines(analysis, "sampler")) == 1


def test_a_sentence_says_where_the_race_of_a_scene_alone_decides(tmp_path):
    """The verdicts of an axis hold for all scenes together, so that a ratio may be decided in its race and not there."""
    scenes = {"hall": 0.0105, "yard": 0.01, "attic": 0.01, "shed": 0.01}
    made = [twins(scene=scene, noise=0.001) for scene in scenes]
    made += [contestant(seconds, scene=scene, sampler="sobol", noise=0.05) for scene, seconds in scenes.items()]
    analysis = analyse(results(tmp_path, *made))
    raced = analysis.comparisons[(analysis.comparisons.measure == TO) & (analysis.comparisons.baseline != "")]
    raced = raced[raced.factor != "A/A"].set_index("scene").verdict
    found = {scene: row.verdict for (_, _, scene, _), row in along(analysis, "sampler").items()}
    alone = [scene for scene in scenes if raced[scene] in ("faster", "slower") and found[scene] == "unresolved"]
    assert alone, (dict(raced), found)
    (line,) = lines(analysis, "sampler")
    assert "in the race of that scene alone, not in all scenes together" in line
    assert all(f" on {scene}" in line.partition("in the race of that scene")[0] for scene in alone)


def test_images_of_several_sizes_are_said_to_have_no_ratio(tmp_path):
    def wide(cell):
        cell.update(width=2 * cell["width"], cell_id=cell["cell_id"] + "wide")

    analysis = analyse(results(tmp_path, contestant(0.01), contestant(0.02, change=wide)))
    assert lines(analysis, "resolution") == ["images of different sizes have no ratio: each size is a race of its own."]
    assert lines(analyse(results(tmp_path / "one", contestant(0.01), contestant(0.02, sampler="sobol"))), "resolution") == []


def test_nothing_is_said_where_nothing_is_compared(tmp_path):
    assert sentences_text(analyse(results(tmp_path, contestant(0.01)))) == ""


@pytest.mark.parametrize(
    ("ratio", "half", "expected"), [(1.2, 0.3, 14), (1.02, 0.3, 378), (1.0, 0.1, 15)], ids=["apart", "same within 5 %", "equal"]
)
def test_the_repeats_that_separate_go_with_the_square_of_the_interval(ratio, half, expected):
    """Of one ratio from 5 blocks: the interval has to shrink to the distance from 1, or from the margin of the same."""
    row = SimpleNamespace(
        ratio=ratio, ratio_low=ratio * math.exp(-half), ratio_high=ratio * math.exp(half), blocks=5, persistent_spread=0.0
    )
    found = repeats_to_separate(row, 1, 0.05)
    assert found == expected
    assert repeats_to_separate(row, 10, 0.05) >= found
    row.persistent_spread = 0.2
    assert repeats_to_separate(row, 1, 0.05) == math.inf, "no repeats narrow what persists"


# In tables


def test_the_table_has_every_format_and_a_reason_for_every_blank(tmp_path):
    def slow(cell):
        cell["points"] = cell["points"][:4]

    made = twins(change=slow), contestant(0.01, sampler="sobol", change=slow)
    analysis = analyse(results(tmp_path, *made, contestant(0.001, sampler="halton", change=slow)))
    tables = {table.name: table for table in all_tables(analysis)}
    table = tables["by_axis"]
    assert len(csv_text(table).splitlines()) == 1 + len(table.rows) == 1 + 2 * 3
    assert "by-axis" in latex_text(table) and "### By axis" in markdown_text(table)
    for each in (table, tables["speedups"], tables["time_to_quality"]):
        for row in each.rows:
            name = "ratio" if each is table else "speedup"
            assert not math.isnan(row[name].value) or row["blank"][name], (each.name, row)
    assert any(row["no_ratio"] for row in table.rows)


def test_the_report_has_scenes_as_rows_and_targets_as_columns(tmp_path):
    of = {table.axis: table for table in axis_tables(samplers(tmp_path))}
    ((words, rows),) = of["sampler"].groups
    assert words == "sobol over random" and of["sampler"].measures == ["seconds per sample", "time to 0.1", TO]
    assert [(row.scene, row.settings) for row in rows][:3] == [("hall", "numba"), ("hall", "embree"), ("yard", "numba")]
    assert all(len(row.cells) == 3 and row.cells[0].title for row in rows)
