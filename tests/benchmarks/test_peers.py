"""Paths per second beside Mitsuba's, each alone; `make speed` gives the ratios, interleaved."""

import numpy as np
import pytest

from engines import Unsupported
from engines.scene import load_scene
from harness.config import paths
from tests.benchmarks.speed import CONTESTANTS, prepared

SIDE, SPP = 128, 4
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@pytest.mark.parametrize("contestant", CONTESTANTS, ids=lambda contestant: contestant.label.replace(" ", "-"))
def test_peer(benchmark, contestant):
    try:
        renderer = prepared(contestant, load_scene(paths.find("scenes", "cornell_box")), (SIDE, SIDE))
    except Unsupported as reason:
        pytest.skip(f"{contestant.label} does not run here: {reason}")
    renderer.render(SPP)
    film = benchmark(renderer.render, SPP)
    benchmark.extra_info["paths_per_second"] = SIDE * SIDE * SPP / benchmark.stats.stats.median
    assert np.isfinite(film.mean()).all()
