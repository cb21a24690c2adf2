"""Keys of cameras, cylinders, sets of spheres and environments, and how what is wrong with them is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.scene import Cylinder, Orthographic, ThinLens

VIEW = {"eye": [0, 0, 3], "target": [0, 0, 0]}


def scene(camera=None, shape=None, light=None):
    shapes = [] if shape is None else [{**shape, "material": "m"}]
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": camera or {"type": "perspective", **VIEW},
            "materials": {"m": {"kd": 0.5}},
            "shapes": shapes,
            "lights": [] if light is None else [{"environment": light}],
        }
    )


def test_cameras_shift_mirror_clip_and_focus():
    film = {"principal_point": [0.1, -0.2], "mirror": True, "clip": [0.5, math.inf]}
    lens = scene({"type": "thin_lens", **VIEW, "aperture_radius": 0.1, "focus_distance": 2, **film}).camera
    assert isinstance(lens, ThinLens) and (lens.aperture_radius, lens.focus_distance) == (0.1, 2)
    assert (lens.principal_point, lens.mirror, lens.clip) == ((0.1, -0.2), True, (0.5, math.inf))
    plain = scene({"type": "orthographic", **VIEW, "height": 2}).camera
    assert isinstance(plain, Orthographic)
    assert (plain.principal_point, plain.mirror, plain.clip) == ((0.0, 0.0), False, (0.0, math.inf))


def test_cylinders_and_sets_of_spheres():
    (cylinder,) = scene(shape={"cylinder": {"p0": [0, 0, 0], "p1": [0, 2, 0], "radius": 0.5}}).shapes
    assert cylinder == Cylinder((0, 0, 0), (0, 2, 0), 0.5, 0)
    for radii in ([1, 2], np.array([1.0, 2.0])):
        (spheres,) = scene(shape={"spheres": {"centers": [[0, 0, 0], [3, 0, 0]], "radii": radii}}).shapes
        assert spheres.radii.tolist() == [1, 2] and spheres.bounds().tolist() == [[-1, -2, -2], [5, 2, 2]]


CAMERAS = [
    ({"clip": [2, 1]}, "camera.clip: must be two distances with 0 <= near < far"),
    ({"clip": [-1, 1]}, "camera.clip: must be two distances"),
    ({"clip": 3}, "camera.clip = 3: must be [near, far]"),
    ({"clip": [math.nan, 1]}, "camera.clip[0] = nan: must be finite"),
    ({"principal_point": [0, 70000]}, "camera.principal_point[1] = 70000: must lie in [-65536, 65536]"),
    ({"type": "thin_lens", "focus_distance": 0, "aperture_radius": 1}, "focus_distance = 0: must be greater than 0"),
    ({"type": "perspective_arctan", "mirror": True}, "camera.mirror: unknown key"),
]
SHAPES = [
    ({"cylinder": {"p0": [0, 0, 0], "p1": [0, 0, 0], "radius": 1}}, "cylinder.p1: must differ from p0"),
    ({"spheres": {"centers": [[0, 0, 0]], "radii": [1, 2]}}, "spheres.radii: must be a list of radii, one for each center"),
    ({"spheres": {"centers": [[0, 0, 0]], "radii": [0]}}, "spheres.radii[0] = 0: must be greater than 0"),
]
SKY = np.ones((2, 4, 3))
LIGHTS = [
    ({"scale": 2}, "environment: needs radiance, image, or both"),
    ({"radiance": 1, "rows": "poles"}, "environment.rows: belongs to an image"),
    ({"image": SKY, "rows": "north"}, "environment.rows = 'north': unknown kind of rows"),
    ({"image": SKY, "rotation": [[1, 0, 0], [0, 1, 0]]}, "rotation: must be three rows"),
    ({"image": SKY, "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}, "rotation: must be a rotation"),
    ({"image": SKY, "rotation": [[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]}, "rotation: must be a rotation"),
    ({"image": SKY[:, :, :1]}, "environment.image: array (2, 4, 1): must have the shape (h, w, 3)"),
    ({"radiance": 1e300, "scale": 1e30}, "environment.scale = 1e+30: must leave radiance finite"),
]


@pytest.mark.parametrize(
    ("where", "keys", "message"),
    [
        *(("camera", {"type": "perspective", **VIEW, **keys}, message) for keys, message in CAMERAS),
        *(("shape", keys, message) for keys, message in SHAPES),
        *(("light", keys, message) for keys, message in LIGHTS),
    ],
)
def test_what_is_wrong_is_refused_where_it_stands(where, keys, message):
    with pytest.raises(SceneError) as refused:
        scene(**{where: keys})
    assert message in str(refused.value) and "\n" not in str(refused.value)
