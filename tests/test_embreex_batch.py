"""The batch engine: embreex finds what the reference finds, and says what it is not made for."""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.errors import Unsupported

CAMERA = {
    "type": "perspective",
    "eye": [0, 0, 5],
    "target": [0, 0, 0],
    "up": [0, 1, 0],
    "fov": 40,
    "fov_axis": "y",
    "resolution": [8, 8],
}


@pytest.mark.parametrize("scene", ["cornell_box", "cornell_spheres", "mesh_sphere"])
def test_the_image_is_the_references_but_for_rays_at_edges(scene):
    """Both draw the same numbers, so that a path differs only where float32 finds another triangle."""
    scene = engines.load_scene(scene)
    settings = Settings(16, 12, shader={"name": "path_tracer", "max_depth": 4}, seed=3)
    ours, theirs = (engines.engine(name).prepare(scene, settings).render(4) for name in ("embreex_batch", "numpy"))
    close = np.isclose(ours.mean(), theirs.mean(), rtol=1e-3, atol=1e-4).all(axis=2).mean()
    assert close > 0.95
    assert ours.mean().mean() == pytest.approx(theirs.mean().mean(), rel=0.01)


def test_flights_through_media_count_from_surfaces_not_from_offset_origins():
    """Where float32 puts these 0.03 m away, a slab of thickness 1 that absorbs passes what the reference says."""
    squares = (np.array([[-9, -9, z], [9, -9, z], [9, 9, z], [-9, 9, z]], float) for z in (1000.0, 1001.0))
    shapes = [
        {"mesh": {"vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]]}, "material": "clear", side: "fog"}
        for corners, side in zip(squares, ("exterior", "interior"), strict=True)
    ]
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "media": {"fog": {"sigma_t": 1, "albedo": 0}},
            "camera": {**CAMERA, "eye": [0, 0, 1003], "target": [0, 0, 1000], "fov": 1e-3},
            "materials": {"clear": {"null": {}}},
            "shapes": shapes,
            "lights": [{"environment": {"radiance": 1}}],
        }
    )
    settings = Settings(64, 64, shader="volumetric_path_tracer", sampler="random")
    ours, theirs = (
        engines.engine(name).prepare(scene, settings).render(4).mean().mean() for name in ("embreex_batch", "numpy")
    )
    assert ours == pytest.approx(theirs, abs=2e-4)
    assert ours == pytest.approx(np.exp(-1.0), abs=0.012)


@pytest.mark.parametrize("away", [0.0, 1e6])
def test_hits_are_exact_even_far_from_the_origin(away):
    faces = [[0, 1, 2], [0, 2, 3]]
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float) + away
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": CAMERA,
            "shapes": [{"mesh": {"vertices": corners, "faces": faces}, "material": "white"}],
            "materials": {"white": {"kd": 0.5}},
        }
    )
    renderer = engines.engine("embreex_batch").prepare(scene, Settings(8, 8, shader="albedo"))
    places = np.random.default_rng(1).uniform(-0.99, 0.99, (1000, 2))
    origins = np.column_stack([places, np.full(1000, 3.0)]) + away
    hits = renderer.trace(origins, np.tile([0, 0, -2.0], (1000, 1)))
    assert np.allclose(hits.t, 1.5, rtol=1e-9)
    assert (hits.primitive == (places[:, 1] > places[:, 0])).all()
    assert renderer.occluded(origins, [[0, 0, -1]]).all() and not renderer.occluded(origins, [[0, 0, 1]]).any()


def test_a_scene_without_triangles_is_declined():
    engine, sphere = (engines.engine("embreex_batch"), {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "white"})
    scene = engines.scene_from({"raybench_scene": 1, "camera": CAMERA, "shapes": [sphere], "materials": {"white": {"kd": 0.5}}})
    assert engine.why_not(scene, Settings()) == "embreex holds triangles only, and none of the shapes is one"
    with pytest.raises(Unsupported, match="triangles only"):
        engine.prepare(scene, Settings())
