"""Exponents of cost: known powers are found, with intervals that cover them as often as they claim."""

import numpy as np
import pytest

from harness.analysis import analyse
from harness.analysis.frames import ResultFrames
from harness.analysis.scaling import exponent, passes, serial_fraction_of, thread_families
from harness.report.tables import all_tables
from tests.harness.synthetic import SMALL, arranged, done_cell
from tests.harness.test_races import SPP, contestant, results


def powers(rng, power, blocks=5, sizes=(100, 1000, 10_000), noise=0.03):
    """Size -> block -> seconds of size^power, times lognormal noise."""
    return {size: {b: size**power * float(rng.lognormal(0, noise)) for b in range(blocks)} for size in sizes}


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_is_found(power):
    seconds = powers(np.random.default_rng(1), power, noise=1e-9)
    found = exponent(seconds, sorted(seconds))
    assert found.value == pytest.approx(power, abs=1e-6) and found.n == 5


def test_intervals_cover_the_exponent_as_often_as_they_claim():
    """95 % of 300: fewer than 272 or more than 297 has p < 1e-3."""
    rng = np.random.default_rng(2)
    runs = [powers(rng, 0.3) for _ in range(300)]
    found = [exponent(seconds, sorted(seconds)) for seconds in runs]
    assert 272 <= sum(e.low <= 0.3 <= e.high for e in found) <= 297


def test_a_drift_of_the_machine_from_block_to_block_does_not_move_it():
    drift = [1.0, 1.5, 0.7, 1.2, 2.0]
    seconds = {size: {b: size * drift[b] for b in range(5)} for size in (10, 100, 1000)}
    found = exponent(seconds, sorted(seconds))
    assert (found.value, found.low, found.high) == pytest.approx((1, 1, 1))


def test_blocks_that_lack_a_size_are_left_out():
    seconds = {10: {0: 1.0, 1: 1.0}, 100: {0: 10.0, 1: 10.0}, 1000: {1: 100.0}}
    assert exponent(seconds, sorted(seconds)).n == 1


@pytest.mark.parametrize(("known", "share"), [({"usable_cores": 2}, 0.0), ({}, 3 / 13)])
def test_a_serial_fraction_is_fitted_up_to_the_usable_cores(known, share, tmp_path):
    """Of a program that two threads run in half the time, and four no sooner than two."""
    case, rng = ("cornell_box", "numba", "bvh", "random"), np.random.default_rng(1)
    cells = [done_cell(tmp_path, (*case, threads, None), 0, 1.0, SMALL, rng, False) for threads in (1, 2, 4)]
    for cell, seconds in zip(cells, (1.0, 0.5, 0.5), strict=True):
        cell["points"] = [{**point, "seconds": point["spp"] * seconds} for point in cell["points"]]
    environment = {"event": "environment", "env_id": "env0", "preimage": known}
    found = arranged(tmp_path, [environment, *cells])
    (family,) = thread_families(found)
    assert serial_fraction_of(found, family).value == pytest.approx(share)


def separately(cell):
    """Every checkpoint is a render of its own, which takes 0.05 s to begin."""
    cell["separate_renders"] = True
    for point in cell["points"]:
        point["seconds"] += 0.05
    cell["phases"] = {"render_seconds": cell["points"][-1]["seconds"]}


def test_a_pass_of_separate_renders_is_the_whole_render(tmp_path):
    found = results(tmp_path, contestant(0.01, noise=0, change=separately))
    (one,) = found.contestants
    area = one.settings.width * one.settings.height
    expected = {spp: {block: (0.05 / spp + 0.01 * (1 + 0.1 * block)) / area for block in range(5)} for spp in SPP}
    assert {spp: pytest.approx(blocks) for spp, blocks in expected.items()} == passes(one)


def test_the_seconds_of_rendering_are_those_of_all_separate_renders(tmp_path):
    """Renders of 1, 2, 4, ..., 128 samples take 255 times the seconds of a sample and 8 beginnings."""
    found = results(tmp_path, contestant(0.01, noise=0, blocks=1, change=separately))
    assert ResultFrames(found).cells.render_seconds.tolist() == pytest.approx([2.95])
    (row,) = next(table for table in all_tables(analyse(found)) if table.name == "phases").rows
    assert row["render_seconds"].value == pytest.approx(2.95)
