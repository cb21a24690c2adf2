"""(u, v) of each shape where rays hit it, and the derivatives of the point, against finite differences."""

import numpy as np
import pytest

from engines.numpy_reference.vectors import frame, unit
from engines.scene import Bump, Cylinder, Disk, ImageTexture, Material, Mixture, Plane, Sphere, Triangle
from tests.numpy_reference.small_scenes import mesh, renderer, scene

RAMP = ImageTexture(np.linspace(0.0, 1.0, 12, dtype=np.float32).reshape(3, 4, 1))
TEXTURED = Material("textured", bsdf=Mixture(kd=RAMP))
UVS = np.array([[0.1, 0.2], [0.9, 0.3], [0.2, 0.8], [1.5, 2.0]])
QUAD = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.1), (0.3, 1.5, 0.2), (2.2, 1.7, -0.1)]
SHAPES = {
    "plane": Plane((0.1, -0.2, 0.3), (0.6, 0.0, 0.8), 0),
    "disk": Disk((0.1, -0.2, 0.3), (0.36, 0.48, 0.8), 1.7, 0),
    "sphere": Sphere((0.3, 0.2, -0.1), 1.3, 0),
    "cylinder": Cylinder((-1.5, 0.3, 0.1), (2.5, 0.6, 0.3), 0.5, 0),
    "triangle": Triangle(*QUAD[:3], 0),
    "mesh": mesh(QUAD, [(0, 1, 2), (2, 1, 3)], uvs=UVS),
    "smooth mesh": mesh(QUAD, [(0, 1, 2), (2, 1, 3)], uvs=UVS, normals=np.tile([0.0, 0.6, 0.8], (4, 1))),
}


def hits(shape, origin, direction, material=TEXTURED):
    """The interactions of rays (n, 3), all of which must hit."""
    context = renderer(scene([shape], [material]))._context
    origin, direction = np.asarray(origin, np.float64).T.copy(), unit(np.asarray(direction, np.float64).T)
    found = context.closest(origin, direction)
    assert (found.primitive_id == found.primitive_id[0]).all() and found.primitive_id[0] >= 0
    return context.surface(origin, direction, found)


def aimed(shape, point, eye):
    return hits(shape, np.tile(eye, (len(point), 1)), np.asarray(point) - eye)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_derivatives_are_those_of_the_point(name, side):
    """Along any step on the surface, dp = dp_du du + dp_dv dv."""
    shape, h = SHAPES[name], 1e-6
    eye = np.array([0.4, 0.5, 6.0 * side])
    middle = aimed(shape, [(0.6, 0.4, 0.2)], eye)
    steps = middle.point.T + h * np.array([[1.0, 0.2, 0.0], [-0.3, 0.8, 0.0], [-1.0, -0.2, 0.0], [0.3, -0.8, 0.0]])
    near = aimed(shape, steps, eye)
    for one, other in ((0, 2), (1, 3)):
        du, dv = near.uv[:, one] - near.uv[:, other]
        moved = near.point[:, one] - near.point[:, other]
        assert np.allclose(middle.dp_du[:, 0] * du + middle.dp_dv[:, 0] * dv, moved, atol=1e-6 * np.abs(moved).max())


def test_a_sphere_has_longitude_from_x_and_latitude_from_the_top():
    directions = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 1], [0, 0, 1], [0, 0, -1.0]])
    found = hits(Sphere((0.0, 0.0, 0.0), 2.0, 0), 5.0 * directions, -directions)
    assert np.allclose(found.uv.T, [(0, 0.5), (0.25, 0.5), (0.5, 0.5), (0.75, 0.5), (0, 0.25), (0, 0), (0, 1)], atol=1e-12)
    assert np.allclose(found.dp_du[:, 1], [-4.0 * np.pi, 0, 0], atol=1e-12)
    assert np.allclose(found.dp_dv[:, 0], [0, 0, -2.0 * np.pi], atol=1e-12)


def test_a_disk_has_radius_and_angle_about_its_normal():
    t1, t2 = (t[:, 0] for t in frame(np.array([[0.0], [0.0], [-1.0]])))
    at = np.array([0.5 * t1, 1.5 * t2, -1.0 * t1, -2.0 * t2])
    found = hits(Disk((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 2.0, 0), at + np.array([0.0, 0.0, 3.0]), np.tile([0, 0, -1.0], (4, 1)))
    assert np.allclose(found.uv.T, [(0.25, 0), (0.75, 0.25), (0.5, 0.5), (1.0, 0.75)], atol=1e-12)


def test_a_plane_is_measured_in_metres_from_its_point():
    found = hits(Plane((1.0, 2.0, 3.0), (0.0, 0.0, 1.0), 0), [(4.0, 7.0, 9.0)], [(0.0, 0.0, -1.0)])
    assert np.allclose(found.uv[:, 0], [3.0, 5.0]) and np.array_equal(found.dp_du[:, 0], [1.0, 0.0, 0.0])


def test_faces_without_coordinates_use_the_weights_of_their_vertices():
    """Also beside a mesh that has some, whose vertices lie on a line in (u, v)."""
    bare = mesh(QUAD, [(0, 1, 2)])
    point = 0.5 * np.array(QUAD[0]) + 0.2 * np.array(QUAD[1]) + 0.3 * np.array(QUAD[2])
    line = mesh(QUAD, [(0, 1, 2)], uvs=np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]))
    for shape, expected in ((bare, (0.2, 0.3)), (SHAPES["triangle"], (0.2, 0.3)), (line, (0.8, 0.8))):
        found = aimed(shape, [point], np.array([0.5, 0.5, 4.0]))
        assert np.allclose(found.uv[:, 0], expected, atol=1e-12)
        assert np.allclose(found.dp_du[:, 0], np.subtract(QUAD[1], QUAD[0]))
        assert np.allclose(found.dp_dv[:, 0], np.subtract(QUAD[2], QUAD[0]))


def test_coordinates_are_computed_where_a_texture_is_alone():
    shape, ray = SHAPES["sphere"], ([(0.3, 0.2, 5.0)], [(0.0, 0.0, -1.0)])
    plain = hits(shape, *ray, material=Material("plain", bsdf=Mixture((0.5, 0.5, 0.5))))
    assert plain.uv is None and plain.dp_dv is None
    bumped = Material("bumped", bsdf=Bump(RAMP, 0.1, Mixture((0.5, 0.5, 0.5))))
    assert np.allclose(hits(shape, *ray, material=bumped).uv, hits(shape, *ray).uv)
    both = scene([shape, Plane((0, 0, -9), (0, 0, 1), 1)], [TEXTURED, Material("plain", (0.5, 0.5, 0.5))])
    context = renderer(both)._context
    origin, direction = np.array([[0.5, 9.0], [0.2, 9.0], [5.0, 5.0]]), np.array([[0.0, 0.0]] * 2 + [[-1.0, -1.0]])
    found = context.surface(origin, direction, context.closest(origin, direction))
    assert found.uv[:, 0].any() and not found.uv[:, 1].any() and not found.dp_du[:, 1].any()


def test_brushed_metal_follows_the_coordinates_of_its_mesh_in_a_scene_without_textures():
    found = hits(SHAPES["mesh"], [(0.6, 0.4, 5.0)], [(0.0, 0.0, -1.0)], Material("plain", (0.5, 0.5, 0.5)))
    textured = hits(SHAPES["mesh"], [(0.6, 0.4, 5.0)], [(0.0, 0.0, -1.0)])
    assert found.uv is None and np.array_equal(found.dp_du, textured.dp_du)
    assert not np.allclose(found.dp_du[:, 0], np.subtract(QUAD[1], QUAD[0]))
