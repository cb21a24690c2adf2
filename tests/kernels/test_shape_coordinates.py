"""Texture coordinates of shapes (docs/transport.md): values at chosen points, and derivatives against differences."""

import numpy as np
import pytest

from engines.kernels.compile.vec3 import Vec3
from engines.kernels.lane.shapes import disk, plane, sphere

CENTER, NORMAL = np.array([1.0, -2.0, 0.5]), np.array([0.36, 0.48, 0.8])
T1, T2 = (np.array([1 - 0.36**2 / 1.8, -0.36 * 0.48 / 1.8, -0.36]), np.array([-0.36 * 0.48 / 1.8, 1 - 0.48**2 / 1.8, -0.48]))


def on_sphere(p):
    return sphere.coordinates(Vec3(*p), Vec3(*CENTER), 2.0)


def on_plane(p):
    return plane.coordinates(Vec3(*p), Vec3(*CENTER), Vec3(*NORMAL))


def on_disk(p):
    return disk.coordinates(Vec3(*p), (*CENTER, *NORMAL, 2.0))


@pytest.mark.parametrize(
    ("coordinates", "offset", "u", "v"),
    [
        (on_sphere, (2.0, 0.0, 0.0), 0.0, 0.5),
        (on_sphere, (0.0, -2.0, 0.0), 0.75, 0.5),
        (on_sphere, (-1.2, 0.0, 1.6), 0.5, np.arccos(0.8) / np.pi),
        (on_plane, 0.75 * T1 - 3.0 * T2, 0.75, -3.0),
        (on_disk, 0.5 * T2, 0.25, 0.25),
        (on_disk, -1.0 * T2, 0.5, 0.75),
        (on_disk, 0.0 * T1, 0.0, 0.0),
    ],
)
def test_points_have_the_coordinates_of_the_specification(coordinates, offset, u, v):
    found = coordinates(CENTER + offset)
    assert np.allclose((found.u, found.v), (u, v), rtol=0, atol=1e-12)


@pytest.mark.parametrize("coordinates", [on_sphere, on_plane, on_disk])
def test_a_step_along_a_derivative_changes_its_coordinate_alone(coordinates):
    step = 1e-7
    for x, y in np.random.default_rng(3).uniform(-1, 1, (20, 2)):
        p = CENTER + x * T1 + y * T2
        if coordinates is on_sphere:
            p = CENTER + 2.0 * (p - CENTER + 0.2 * NORMAL) / np.linalg.norm(p - CENTER + 0.2 * NORMAL)
        at = coordinates(p)
        for d, along in ((at.dp_du, (1, 0)), (at.dp_dv, (0, 1))):
            after = coordinates(p + step * np.array(d))
            assert np.allclose((after.u - at.u, after.v - at.v), np.multiply(step, along), rtol=0, atol=1e-11)
