"""Results arranged from few events: names, cells of both kinds, races of rays, and who may be the fastest."""

from typing import get_args

import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.analysis.rays import ray_races
from harness.config.settings import RAY_KINDS
from harness.report.chapter.document import Listing, Paragraph
from harness.report.chapter.experiment import contended_cells, limits
from harness.report.plots.panels import panels
from harness.report.rays_text import rays_text
from harness.report.tables.rays import rays as rays_table
from harness.report.winners import standing, winners_text
from harness.store.records import RayKind
from tests.harness.synthetic import SMALL, arranged, base_cell
from tests.harness.test_races import contestant

ANSWERS = {"sha256": "a", "checked": 100, "wrong": 0, "missed": 0, "false_hits": 0, "hard": 10, "leaks": 0}


def ray_cell(block=0, engine="numpy", **given):
    """A cell that traced 1000 camera rays once in a second."""
    return {
        "event": "ray_cell",
        "cell_id": f"{engine}-{block}",
        "env_id": "env0",
        "state": "done",
        "block": block,
        "seed": block,
        "scene": "hall",
        "scene_hash": "shall",
        "engine": engine,
        "accelerator": {"name": "auto"},
        "precision": None,
        "threads": 1,
        "rays": "camera",
        "ray_set_id": "set0",
        "count": 1000,
        "passes": 1,
        "seconds": 1.0,
        "answers": ANSWERS,
        "machine": {"contended": False},
        **given,
    }


def rendering(engine="numba", block=0, accelerator="bvh", **given):
    """A cell that rendered to an error of 0.01 in a second."""
    cell = base_cell(("hall", engine, accelerator, "random", 1, None), block, SMALL)
    point = {"spp": 4, "seconds": 1.0, "rays": 1, "metrics": {"relmse_e0.01": 0.01, "relmse_e0.01_se": 1e-5}, "image": None}
    return cell | {"points": [point]} | given


TARGETS = {"event": "targets", "metric": "relmse_e0.01", "targets": [0.1]}


def test_an_ssim_of_one_among_the_targets_of_events_is_left_out(tmp_path):
    def good(cell):
        for point in cell["points"]:
            point["metrics"]["ssim"] = 0.95

    events = [{"event": "targets", "metric": "ssim", "targets": [0.9, 1.0]}, *contestant(0.01, change=good)]
    found = analyse(arranged(tmp_path, events))
    assert found.results.targets == [0.9] and found.by_target.seconds.notna().all()


def test_names_tell_apart_the_accelerators_of_an_engine_that_was_not_measured(tmp_path):
    broken = [rendering("numba", accelerator=name, state="failed", points=[]) for name in ("bvh", "grid")]
    results = arranged(tmp_path, [rendering("numpy"), *broken])
    assert [c.name for c in results.contestants] == ["numba bvh", "numba grid", "numpy"]


def test_a_chapter_counts_cells_that_trace_rays(tmp_path):
    results = arranged(
        tmp_path,
        [rendering(), ray_cell(machine={"contended": True}), ray_cell(engine="embree", state="failed", message="out of rods")],
    )
    results.manifest = results.manifest.model_copy(update={"cell_ids": [cell.cell_id for cell in results.all_cells]})
    analysis = analyse(results)
    (said, reasons) = limits(analysis).parts
    assert isinstance(said, Paragraph) and isinstance(reasons, Listing)
    assert said.sentences[:1] == ["Of 3 cells, 2 done and 1 failed."] and not any("begun" in each for each in said.sentences)
    assert reasons.items == ["embree with camera rays on hall: failed, out of rods."] and contended_cells(analysis) == 1


def test_kinds_of_rays_are_those_of_the_config(tmp_path):
    assert get_args(RayKind) == RAY_KINDS
    with pytest.raises(ConfigError, match="rays"):
        arranged(tmp_path, [ray_cell(rays="curved")])


def test_rays_race_with_those_of_their_own_set_and_any_number_of_a_block(tmp_path):
    cells = [ray_cell(b, engine, seconds=s) for engine, s in (("numpy", 2.0), ("embree", 1.0)) for b in (0, 2**60)]
    other = [ray_cell(7, engine, ray_set_id="set1") for engine in ("numpy", "embree")]
    first, second = ray_races(arranged(tmp_path, [*cells, *other]))
    assert [[len(one.cells) for one in race] for race in (first, second)] == [[2, 2], [1, 1]]
    assert first[1].ratio is not None and first[1].ratio.ratio == pytest.approx(0.5)


def test_calls_of_no_seconds_are_in_no_race(tmp_path):
    cells = [ray_cell(b, "numpy") for b in range(3)]
    cells += [ray_cell(b, "embree", seconds=0.0 if b == 2 else 0.5) for b in range(3)]
    ((embree, numpy),) = ray_races(arranged(tmp_path, cells))
    assert numpy.ratio is not None and (numpy.ratio.ratio, numpy.ratio.blocks) == (pytest.approx(0.5), 2)
    assert embree.rates() == pytest.approx([0.002, 0.002])


def test_rays_without_answers_or_contention_are_said_to_be_such(tmp_path):
    results = arranged(tmp_path, [ray_cell(b, answers=None, machine={}) for b in range(2)])
    text = rays_text(results)
    assert "1 thread; no answers checked" in text and text.endswith("Contention was not measured.\n")
    assert rays_table(results).rows[0]["contended"] is None
    busy = rays_text(arranged(tmp_path, [ray_cell(b, machine={"contended": not b}) for b in range(2)]))
    assert "100 rays checked, 10 hard rays" in busy and "1 of 2 timings is contended. Times of a busy machine" in busy


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"relmse_e0.01_se": 1.0}, "the reference is too noisy to rank those that reached it"),
        ({"nonfinite": 3.0}, "none that reached it is ranked; flagged, so not ranked: numba (non-finite pixels)"),
        ({"relmse_e0.01": 0.5}, "not reached"),
    ],
)
def test_why_nobody_is_the_fastest_is_said(tmp_path, given, words):
    cell = rendering()
    cell["points"][0]["metrics"] |= given
    analysis = analyse(arranged(tmp_path, [cell, TARGETS]))
    assert winners_text(analysis).splitlines()[1].endswith(f" to 0.1: {words}")
    assert words.startswith(standing(analysis, panels(analysis)[0], 0.1).nobody)
