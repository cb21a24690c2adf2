"""A function that returns images is an engine: its film, seeds, errors and code."""

import sys

import numpy as np
import pytest

import engines
from engines import Settings, UnknownName
from engines.conformance import check_engine
from engines.errors import RendererFailed
from engines.peers.function import FunctionEngine
from harness.source_hashes import engine_code

SCENE = engines.load_scene("scenes/two_spheres.yaml")
SMALL = Settings(6, 5, sampler="random", seed=3)


def by_numpy(scene, settings, spp, seed):
    """Delegates to the NumPy engine, as a function around a renderer does."""
    settings = Settings(*settings.size(scene), settings.shader, settings.sampler, seed=seed)
    return engines.engine("numpy").prepare(scene, settings).render(spp).mean()


def test_a_function_that_renders_conforms():
    found = check_engine(engines.from_function(by_numpy))
    assert [str(finding) for finding in found if finding.verdict == "broken"] == []
    held = {finding.key for finding in found if finding.ok}
    assert {"the_furnace_is_uniform", "images_are_upright", "seeds_matter", "update_of_the_camera_starts_anew"} <= held


def test_the_film_is_the_mean_of_calls_with_seeds_of_their_own():
    calls = []

    def render(scene, settings, spp, seed):
        calls.append((spp, seed))
        return np.full((5, 6, 3), float(len(calls)))

    renderer = engines.from_function(render).prepare(SCENE, SMALL)
    renderer.warm_up()
    renderer.render(2)
    film = renderer.render(6)
    np.testing.assert_allclose(film.mean(), (2 * 2 + 6 * 3) / 8)
    assert [spp for spp, _ in calls] == [1, 2, 6] and calls[1][1] != calls[2][1]


def test_an_image_of_another_shape_is_named():
    renderer = engines.from_function(lambda *_: np.zeros((6, 5, 3)), "turned").prepare(SCENE, SMALL)
    with pytest.raises(RendererFailed, match=r"turned: returned an array of shape \(6, 5, 3\): expected \(5, 6, 3\)"):
        renderer.render(1)


def test_names_are_checked_before_the_function_is_called():
    engine = engines.from_function(by_numpy)
    with pytest.raises(UnknownName, match="did you mean 'random'"):
        engine.why_not(SCENE, Settings(sampler="randon"))
    assert engine.why_not(SCENE, SMALL) is None and engine.name == "by_numpy"


def test_a_file_names_a_function_by_its_module_and_a_change_is_another_engine(tmp_path, monkeypatch):
    code = "def render(scene, settings, spp, seed):\n    return {}\n"
    (tmp_path / "painter.py").write_text(code.format(1))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "painter", raising=False)
    engine = engines.engine("painter:render")
    assert isinstance(engine, FunctionEngine) and engine.name == "painter.render"
    before = engine_code(engine, "painter:render")
    (tmp_path / "painter.py").write_text(code.format(2))
    assert engine_code(engine, "painter:render") != before
