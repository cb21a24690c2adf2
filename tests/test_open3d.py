"""The engine `open3d`: it renders nothing, says so, and traces triangles where Open3D is installed."""

import numpy as np
import pytest

import engines
from engines import Settings, UnknownName, Unsupported
from engines.interface import HasTracer
from engines.packages import install_extra
from engines.peers.open3d import Engine
from engines.scene import scene_from
from tests.needs import needs
from tests.test_layout import ROOT


@pytest.fixture(scope="module")
def box():
    return engines.load_scene(ROOT / "scenes" / "cornell_box.yaml")


def test_it_renders_nothing_and_says_what_it_lacks(box):
    engine = Engine()
    assert isinstance(engine, HasTracer)
    assert engine.why_not(box, Settings()) == "Open3D traces rays and renders no images: raybench race --rays compares it"
    with pytest.raises(Unsupported, match="renders no images"):
        engine.prepare(box, Settings())
    with pytest.raises(UnknownName):
        engine.why_not_tracer(box, Settings(accelerator="bvh"))
    ball = scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0], "fov": 40},
            "materials": {"grey": {"kd": 0.5}},
            "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}],
        }
    )
    lacks = "shapes[0]: Open3D's RaycastingScene does not support the shape Sphere"
    assert engine.why_not_tracer(ball, Settings()) == lacks
    assert engine.why_not_tracer(box, Settings(precision="float64")) == "Open3D traces in float32 only"
    with pytest.raises(Unsupported, match="float32 only"):
        engine.tracer(box, Settings(precision="float64"))


def test_what_is_not_installed_is_named(box, monkeypatch):
    monkeypatch.setattr("engines.peers.open3d.engine.util.find_spec", lambda name: None)
    assert Engine().why_not_tracer(box, Settings()) == f"Open3D is not installed: {install_extra('open3d')}"


@needs("open3d")
def test_its_answers_are_those_of_numpy(box):
    rng = np.random.default_rng(4)
    origins, directions = rng.uniform(-0.9, 0.9, (500, 3)), rng.normal(size=(500, 3))
    t_max = np.where(np.arange(500) % 2, np.inf, rng.uniform(0.1, 2, 500))
    directions[:3], t_max[3], origins[4, 1] = 0.0, -1.0, np.nan
    ours, theirs = Engine().tracer(box, Settings()), engines.engine("numpy").prepare(box, Settings())
    found, wanted = ours.trace(origins, directions, t_max), theirs.trace(origins, directions, t_max)
    alone = wanted.shape != 0  # on the floor stands a box, whose bottom is as near
    assert (found.shape == wanted.shape)[alone].all() and (found.primitive == wanted.primitive)[alone].all()
    hit = np.isfinite(wanted.t)
    assert 0.3 < hit.mean() < 0.9 and not hit[:5].any()
    assert (np.isfinite(found.t) == hit).all() and np.allclose(found.t[hit], wanted.t[hit], rtol=1e-5)
    assert np.allclose(found.normal, wanted.normal, atol=1e-5)
    assert np.allclose(found.u[alone], wanted.u[alone], atol=1e-4)
    assert np.allclose(found.v[alone], wanted.v[alone], atol=1e-4)
    assert (ours.occluded(origins, directions, t_max) == theirs.occluded(origins, directions, t_max)).all()
