"""Films on their way from a worker: how many samples they may hold."""

import pytest

from engines.errors import RendererFailed
from engines.film import Film
from harness.measure.films import leave, take


@pytest.mark.parametrize(
    ("spp", "overshoots", "taken"), [(3, False, True), (2, False, False), (2, True, True), (4, True, False)]
)
def test_only_an_engine_that_overshoots_may_have_more_samples_than_were_asked_for(tmp_path, spp, overshoots, taken):
    film, file = Film(2, 1), tmp_path / "film.npz"
    film.add_mean(film.mean() + 1.0, 3)
    for call in (lambda: leave(film, file, 2, 1, spp, overshoots), lambda: take(file, 2, 1, spp, overshoots)):
        if taken:
            call()
            continue
        with pytest.raises(RendererFailed, match=f"film.counts are 3: {spp} is expected"):
            call()
        leave(film, file, 2, 1, 3)
