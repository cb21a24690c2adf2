"""An anisotropic conductor on plane, disk and sphere, seen from front and back: the engines have the same tangents."""

import numpy as np
import pytest

import engines
from engines import Settings
from tests.needs import needs

ALPHA = (0.6, 0.2)
DISK = {"disk": {"center": [1.2, 0, 0], "normal": [0.5, 0.6, 0.62], "radius": 0.9}, "material": "metal"}
SPHERE = {"sphere": {"center": [-1.2, 0, 0], "radius": 0.8}, "material": "metal"}
PLANE = {"plane": {"point": [0, -1.2, 0], "normal": [0.3, 0.6, 0.74]}, "material": "metal"}
VIEWS = {
    "front": ([0.2, 0.8, 2.6], [0, 0, 0]),
    "behind the plane": ([0.5, -3, -6], [0, -1.2, 0]),
    "behind the disk": ([2, -0.2, -1], [1.2, 0, 0]),
    "inside the sphere": ([-1.1, 0.2, 0.1], [-1.9, -0.5, -0.6]),
}
LIT = {"name": "path_tracer", "max_depth": 2}


def image(engine, shapes, view, alpha=ALPHA, spp=2, **settings):
    """Lit by a point beside the eye, without noise but for the place in the pixel."""
    eye, target = VIEWS[view]
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "materials": {"metal": {"conductor": {"metal": "Au", "alpha": list(alpha)}}},
            "camera": {"type": "perspective", "eye": eye, "target": target, "fov": 50},
            "shapes": shapes,
            "lights": [{"point": {"position": np.add(eye, [0.05, 0.3, 0.05]).tolist(), "intensity": 1}}],
        }
    )
    renderer = engines.engine(engine).prepare(scene, Settings(16, 12, LIT, "random", **settings))
    return renderer.render(spp).mean()


@pytest.mark.parametrize("view", VIEWS)
def test_numba_has_the_tangents_of_the_reference(view):
    shapes = [PLANE, DISK, SPHERE]
    reference, found = image("numpy", shapes, view), image("numba", shapes, view, precision="float64")
    assert (reference > 0).any(axis=2).mean() > 0.1
    assert np.allclose(found, reference, rtol=1e-8, atol=1e-12)
    assert not np.allclose(found, image("numpy", shapes, view, ALPHA[::-1]), rtol=0.2), "the order of roughnesses shows"


@pytest.mark.parametrize("view", [view for view in VIEWS if view != "behind the plane"])
@needs("mitsuba-scalar")
def test_mitsuba_has_the_tangents_of_the_reference(view):
    """Of disks and spheres: on planes it declines anisotropic conductors."""
    reference, other = (image("numpy", [DISK, SPHERE], view, alpha, 256).mean() for alpha in (ALPHA, ALPHA[::-1]))
    found = image("mitsuba_scalar", [DISK, SPHERE], view, spp=256, precision="float32").mean()
    assert found == pytest.approx(reference, rel=0.02)
    assert found != pytest.approx(other, rel=0.03), "the order of roughnesses shows"
