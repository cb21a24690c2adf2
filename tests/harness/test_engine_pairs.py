"""Pairs of engines: equal ones are called equal, a biased one different, with numbers and words that say so."""

import shutil

import pytest

from harness.analysis import analyse
from harness.analysis.equivalence import Replicates, describe, engine_pairs, rests_on
from harness.config import recorded
from harness.report.tables.equivalence import equivalence as equivalence_table
from harness.store.results import load_results
from tests.harness.synthetic import BIASED, write_folder


@pytest.fixture(scope="module")
def analysis(tmp_path_factory):
    return analyse(load_results(write_folder(tmp_path_factory.mktemp("bias_and_equivalence"), threads=(1,))))


def test_every_pair_of_engines_is_compared_under_equal_settings_once(analysis):
    seen = [
        (p.first.settings.scene, p.first.settings.sampler, *sorted((p.first.settings.engine, p.second.settings.engine)))
        for p in analysis.engine_pairs
    ]
    assert len(seen) == len(set(seen)) == 2 * 2 * 3
    assert all(p.first.settings.sampler == p.second.settings.sampler for p in analysis.engine_pairs)
    assert not any(p.first.settings.label or p.second.settings.label for p in analysis.engine_pairs)


def test_the_biased_engine_differs_from_both_others_and_nothing_else_differs(analysis):
    for pair in analysis.engine_pairs:
        biased = any((c.settings.scene, c.settings.engine) == BIASED for c in (pair.first, pair.second))
        assert (pair.verdict == "different") == biased, (pair.first.name, pair.second.name)


def test_words_say_what_was_found_and_on_how_many_images(analysis):
    for pair in analysis.engine_pairs:
        told = describe(pair.comparison.found)
        assert rests_on(pair.comparison).startswith("5 pairs of images at ")
        assert "the image means differ by" in told if pair.verdict == "different" else "differ by at most" in told


def test_the_table_has_a_row_a_pair_with_bounds(analysis):
    rows = equivalence_table(analysis).rows
    assert len(rows) == len(analysis.engine_pairs)
    assert all(0 < row["image_bound"] < row["tile_bound"] < 1 for row in rows)
    assert all(row["image_bound"] == pytest.approx(max(map(abs, row["difference"][1:3]))) for row in rows)


def test_the_margins_are_those_of_the_config(analysis):
    from dataclasses import replace

    config = {"raybench_experiment": 1, "include": [], "equivalence": {"image": 0.2, "tile": 0.9}}
    results = replace(analysis.results, config=recorded(config, ""))
    pairs = engine_pairs(results, Replicates(results), {})
    assert {pair.verdict for pair in pairs} == {"equivalent"}


def test_unequal_samples_are_taken_where_they_say_more_and_the_words_say_so(analysis):
    """numpy has fewer samples; images of one seed share no noise here, so that the last ones have less of it."""
    pairs = [pair for pair in analysis.engine_pairs if "numpy" in (pair.first.settings.engine, pair.second.settings.engine)]
    compared = [pair.comparison for pair in pairs]
    assert compared and not any(comparison.paired for comparison in compared)
    assert all(comparison.spp[0] != comparison.spp[1] and " and " in rests_on(comparison) for comparison in compared)


def test_images_of_one_seed_are_taken_at_equal_samples_where_they_share_their_noise(tmp_path):
    folder = write_folder(tmp_path / "shared", seeds=3, threads=(1,))
    results = load_results(folder)
    for contestant in results.contestants:
        for cell in contestant.done:
            for point in cell.points:
                source = f"images/cornell_box-numba-bvh-random-1-None-{cell.block}/spp{point.spp:04d}.exr"
                if point.image and point.image != source:
                    shutil.copyfile(folder / source, folder / point.image)
    (pair, *_) = [pair for pair in engine_pairs(results, Replicates(results), {}) if pair.first.settings.scene == "cornell_box"]
    assert pair.comparison.paired and pair.verdict == "identical" and pair.comparison.found.image_bound == 0
    words = "draw the same numbers, and their images are identical up to rounding in 100 % of the pixels"
    assert words in describe(pair.comparison.found)
