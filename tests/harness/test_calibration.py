"""What `raybench calibrate` says is true: on noise of known size, in a run, in an archive and where a run is too small."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness import store
from harness.analysis import analyse, calibration
from harness.report.archive import archive
from harness.report.html.assembly import report_html
from harness.report.tables import all_tables
from harness.statistics import UNKNOWN_SPREAD, PersistentSpread
from harness.statistics.bias import IMAGE_FLAG_Z, RadianceSample
from harness.statistics.calibration import RaceNoise, bias_figures, race_figures, scaled_residuals
from harness.statistics.tiles import TileSample
from harness.store.events import line_of
from harness.store.records import Calibration
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.synthetic import Size, write_folder

MIDDLE = 0.84
"""The normal quantile of 80 %."""


def noise(sd, k=6, n=5, spread=0.0, twins=4):
    found = PersistentSpread(spread**2, twins, sd**2 / n) if twins else UNKNOWN_SPREAD
    return RaceNoise(np.random.default_rng(3).normal(0, sd, 4000), k, n, found)


@pytest.mark.parametrize(("k", "n"), [(2, 3), (4, 7)])
def test_residuals_are_as_wide_as_the_noise(k, n):
    """Unscaled, those of two contestants in three blocks have a third of its variance."""
    rng = np.random.default_rng(1)
    drawn = [scaled_residuals(rng.normal(0, 0.1, n) + rng.normal(0, 1, (k, n))) for _ in range(2000)]
    assert np.var(np.concatenate(drawn)) == pytest.approx(1, rel=0.05)
    assert scaled_residuals(np.zeros((1, 5))) is None and scaled_residuals(np.zeros((3, 2))) is None


def test_races_of_known_noise():
    """20 % slower is seen at 2 % noise; at 30 % noise, and where as much persists, hardly ever."""
    rng = np.random.default_rng(2)
    quiet, loud, apart = (race_figures([made], 200, rng) for made in (noise(0.02), noise(0.3), noise(0.02, spread=0.2)))
    for found in (quiet, loud, apart):
        assert found.false_winners <= 0.03 and found.coverage >= 0.92 and found.false_differences <= 0.15
    assert quiet.power[1] >= 0.97 and loud.power[1] < 0.1 and apart.power[1] < 0.2 and quiet.power[0] < quiet.power[1]
    pair = race_figures([noise(0.05, k=2, twins=0), noise(0.05, k=3)], 200, rng)
    assert pair.power[1] < 0.9, "without twins the spread is unknown, and nothing is called slower"


def image_noise(se, n=5, rows=6):
    """Tiles of radiance 1, whose mean over n blocks has a standard error of `se`; those of the image mean are 1/6 of it."""
    truth = np.ones((rows, rows, 3))
    means = np.random.default_rng(4).normal(0, se * math.sqrt(n), (n, rows, rows, 1)) * truth
    within = np.full_like(truth, n * se**2)
    return RadianceSample(TileSample(means, within, np.full((rows, rows, 1), 256.0)), truth, truth, np.ones(3))


def test_the_smallest_bias_is_that_of_the_known_noise():
    """Channels share their noise here, so that 80 % are found at 0.84 standard errors beyond the flag."""
    se = 0.01
    found = bias_figures([image_noise(se)], 300, np.random.default_rng(5))
    assert found.smallest_image == pytest.approx((IMAGE_FLAG_Z + MIDDLE) * se / 6, rel=0.3)
    assert found.smallest_tile == pytest.approx((4.7 + MIDDLE) * se, rel=0.3)
    assert found.false_alarms <= 0.03 and found.found_image > 0.9 and found.found_tile > 0.9
    louder = bias_figures([image_noise(4 * se)], 100, np.random.default_rng(5))
    assert louder.smallest_image > 3 * found.smallest_image and louder.found_tile < 0.2


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    whole = write_folder(tmp_path_factory.mktemp("calibrated") / "results", Size(64, 64), threads=(1,))
    out = tmp_path_factory.mktemp("archived") / "small"
    archive(whole, out)
    return whole, out


def test_an_archive_without_images_keeps_the_figures_of_the_run(folders):
    ours, kept = (calibration.calibrate(analyse(load_results(folder))) for folder in folders)
    assert ours.races is not None and ours.bias is not None and not calibration.missed(ours)
    assert calibration.figures(kept) == calibration.figures(ours) and calibration.rests_on(kept) == calibration.rests_on(ours)


def test_an_archive_of_earlier_rules_is_judged_by_these_and_keeps_the_figures_of_its_images(folders):
    analysis = analyse(load_results(folders[1]))
    ours = analysis.results.calibration
    old = ours.replaced(races=ours.races._replace(coverage=0.5, false_differences=None))
    found = calibration.calibrate(replace(analysis, results=replace(analysis.results, calibration=old)))
    assert calibration.figures(found) == calibration.figures(ours)


def test_races_without_twins_are_named(folders):
    """Nothing is called slower in them, whatever their noise."""
    analysis = analyse(load_results(folders[0]))
    unknown = dict.fromkeys(analysis.spreads, UNKNOWN_SPREAD)
    bare = calibration.calibrate(replace(analysis, spreads=unknown), 1)
    assert bare.races.power == (0, 0) and bare.races.false_winners == bare.races.false_differences == 0
    assert f"{bare.race_count} of the races have no A/A twins" in calibration.rests_on(bare)


def test_the_command_prints_six_figures_and_the_report_shows_them(folders):
    done = sweeping.raybench("calibrate", folders[1])
    assert done.returncode == 0, done.stderr
    analysis = analyse(load_results(folders[1]))
    page = report_html(analysis, all_tables(analysis), [])
    figures = calibration.figures(calibration.calibrate(analysis))
    assert len(figures) == 6
    said = " ".join(done.stdout.split())
    for figure in figures:
        assert figure.name in said and f"<dt>{figure.name}</dt><dd>{figure.value}" in page


def test_a_missed_figure_is_exit_code_1(folders, tmp_path):
    """Figures that are out of bounds, as of a run whose intervals are too narrow."""
    _, out = folders
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / store.MANIFEST).write_bytes((out / store.MANIFEST).read_bytes())
    events = store.read_events(out)
    kept = store.last_event(events, Calibration)
    narrow = kept.replaced(races=kept.races._replace(coverage=0.8))
    (broken / store.EVENTS).write_bytes(b"".join(map(line_of, [*events, narrow])))
    done = sweeping.raybench("calibrate", broken)
    assert done.returncode == 1 and "missed" in done.stdout


def test_a_run_that_is_too_small_is_told_so(tmp_path):
    folder = write_folder(tmp_path / "results", seeds=2, with_images=False, threads=(1,))
    found = calibration.calibrate(analyse(load_results(folder)))
    assert found.races is None and found.bias is None and not calibration.missed(found)
    words = [figure.value for figure in calibration.figures(found)]
    assert words == [f"unknown: {calibration.NO_RACES}", f"unknown: {calibration.NO_IMAGES}"]


@pytest.mark.parametrize("text", [None, '{"event": "calibration", "races": {"coverage": 2}}\n'])
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, text):
    if text is not None:
        (tmp_path / store.EVENTS).write_text(text)
    done = sweeping.raybench("calibrate", tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr and str(tmp_path) in done.stderr
