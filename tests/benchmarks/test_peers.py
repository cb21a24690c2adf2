"""Paths a second beside Mitsuba's, each alone; `python tests/benchmarks/peers.py` gives the ratios, interleaved."""

import numpy as np
import pytest

from engines.scene import load_scene
from harness.config import paths
from tests.benchmarks.peers import CONTESTANTS, prepared

SIDE, SPP = 128, 4
pytestmark = pytest.mark.benchmark(max_time=0.5, min_rounds=5, disable_gc=True)


@pytest.mark.parametrize("contestant", CONTESTANTS, ids=lambda contestant: contestant.label.replace(" ", "-"))
def test_peer(benchmark, contestant):
    renderer = prepared(contestant, load_scene(paths.find("scenes", "cornell_box")), (SIDE, SIDE), 2)
    if renderer is None:
        pytest.skip(f"{contestant.label} does not run here")
    renderer.render(SPP)
    film = benchmark(renderer.render, SPP)
    benchmark.extra_info["paths_per_second"] = SIDE * SIDE * SPP / benchmark.stats.stats.median
    assert np.isfinite(film.mean()).all()
