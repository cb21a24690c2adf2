"""Pairs of engines: equal ones are called equal, a biased one different, with numbers and words that say so."""

import numpy as np
import pytest

from harness.analysis import analyse
from harness.analysis.equivalence import describe_pair
from harness.report.tables.equivalence import corrected
from harness.report.tables.equivalence import equivalence as equivalence_table
from harness.statistics import equivalence
from harness.store.results import load_results
from tests.harness.synthetic import BIASED, write_folder

TRUTH = np.random.default_rng(0).uniform(0.2, 1.5, (24, 24, 3))


@pytest.fixture(scope="module")
def analysis(tmp_path_factory):
    return analyse(load_results(write_folder(tmp_path_factory.mktemp("bias_and_equivalence"), threads=(1,))))


def noise(rng, count=5, sigma=0.3):
    return sigma * (rng.gamma(0.5, 1.0, (count, *TRUTH.shape)) - 0.5) / np.sqrt(0.5)


def test_every_pair_of_engines_is_compared_under_equal_settings_once(analysis):
    seen = [(p.first.settings.scene, p.first.settings.sampler, *sorted((p.first.settings.engine, p.second.settings.engine)))
            for p in analysis.pairs]  # fmt: skip
    assert len(seen) == len(set(seen)) == 2 * 2 * 3
    assert all(p.first.settings.sampler == p.second.settings.sampler for p in analysis.pairs)
    assert not any(p.first.settings.label or p.second.settings.label for p in analysis.pairs)


def test_the_biased_engine_differs_from_both_others_and_nothing_else_differs(analysis):
    for pair in analysis.pairs:
        biased = any((c.settings.scene, c.settings.engine) == BIASED for c in (pair.first, pair.second))
        assert (pair.verdict == "different") == biased, describe_pair(pair)


def test_words_say_who_what_and_on_how_many_images(analysis):
    for pair in analysis.pairs:
        told = describe_pair(pair)
        assert pair.first.name in told and pair.second.name in told and "5 and 5 images of" in told
        assert "would have been seen" in told
        if pair.verdict == "different":
            assert "means differ by" in told or "stand out" in told or "than chance" in told


def test_the_table_has_a_row_a_pair_with_corrected_p_values(analysis):
    rows = equivalence_table(analysis).rows
    assert len(rows) == len(analysis.pairs)
    assert all(0 <= row[name] <= 1 for row in rows for name in ("image_p", "tile_p", "pixel_p", "ks_p"))
    assert corrected(1 - 0.99 ** (1 / 400), 1 - 0.99 ** (1 / 400)) == pytest.approx(0.01)


def test_pairs_of_one_seed_see_what_independent_ones_cannot():
    """Engines that share their noise: a bias of 0.1 % is beyond Welch's test and plain in pairs."""
    rng = np.random.default_rng(3)
    shared = TRUTH + noise(rng)
    apart, together = (equivalence(shared, 1.001 * shared, paired=paired) for paired in (False, True))
    assert together.low < together.difference < together.high < 0.01
    assert together.detectable < 0.05 * apart.detectable
    assert together.image_p < 1e-4 < apart.image_p and together.verdict == "equivalent"
    assert equivalence(shared, 1.03 * shared, paired=True).verdict == "different"


def test_pairs_of_independent_noise_raise_no_more_false_alarms_than_stated():
    """The margin test of equal images: p below 0.05 in at most 5 %; more than 17 of 200 has p < 0.02."""
    rng = np.random.default_rng(4)
    small = TRUTH[:8, :8]
    alarms = sum(
        equivalence(small + noise(rng)[:, :8, :8], small + noise(rng)[:, :8, :8], paired=True).image_p < 0.05
        for _ in range(200)
    )
    assert 1 <= alarms <= 17
