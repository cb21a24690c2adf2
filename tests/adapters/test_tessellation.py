"""Triangles that stand for other shapes: their area, which way they face, and their normals."""

import numpy as np
import pytest

from engines.peers.adapters.geometry import pieces, two_sides
from engines.peers.adapters.tessellation import cylinder_mesh, disk_mesh, sphere_mesh, squares
from engines.scene import Cylinder, Disk, Mesh, Plane

NORMAL = (0.6, 0.0, -0.8)


def doubled_areas(vertices, faces):
    """(m, 3) cross products of two sides of each face."""
    a, b, c = np.asarray(vertices)[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


@pytest.mark.parametrize(("same_area", "area"), [(True, 4 * np.pi), (False, 4 * 25 * np.sin(2 * np.pi / 50))])
def test_a_disk_faces_its_front(same_area, area):
    made = disk_mesh(Disk((1.0, 2.0, 3.0), NORMAL, 2.0, 0), 50, same_area)
    found = doubled_areas(made.vertices, made.faces)
    np.testing.assert_allclose(found.sum(axis=0) / 2, area * np.array(NORMAL), atol=1e-12)
    assert (found @ NORMAL > 0).all() and made.normals is None
    np.testing.assert_allclose((made.vertices - [1, 2, 3]) @ NORMAL, 0, atol=1e-14)


def test_a_cylinder_faces_outwards_and_is_smooth():
    shape = Cylinder((1.0, 0.0, 0.0), (1.0, 3.0, 4.0), 0.5, 0)
    made = cylinder_mesh(shape, 64)
    found = doubled_areas(made.vertices, made.faces)
    axis = np.array([0.0, 0.6, 0.8])
    away = made.vertices - shape.p0
    away -= (away @ axis)[:, None] * axis
    np.testing.assert_allclose(made.normals, away / 0.5, atol=1e-14)
    assert (np.einsum("fc,fc->f", found, made.normals[made.faces].sum(axis=1)) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(found, axis=1).sum() / 2, 5 * 64 * np.sin(np.pi / 64), rtol=1e-12)
    np.testing.assert_allclose(np.unique(((made.vertices - shape.p0) @ axis).round(9)), [0, 5])


@pytest.mark.parametrize("halves", [[3.0], [1.0, 4.0, 16.0]])
def test_squares_cover_a_plane_once_and_face_its_front(halves):
    vertices, faces = squares(Plane((0.0, 1.0, 0.0), NORMAL, 0), halves)
    found = doubled_areas(vertices, faces)
    np.testing.assert_allclose(found.sum(axis=0) / 2, (2 * halves[-1]) ** 2 * np.array(NORMAL), rtol=1e-12, atol=1e-12)
    assert (found @ NORMAL > 0).all() and len(faces) == 8 * len(halves) - 6


def test_a_sphere_faces_outwards():
    vertices, faces = sphere_mesh(2)
    assert len(faces) == 320
    assert (np.einsum("fc,fc->f", doubled_areas(vertices, faces), vertices[faces].sum(axis=1)) > 0).all()


def test_pieces_and_their_sides_hold_each_face():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces, materials = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 1]], np.int32), np.array([4, 2, 4], np.int32)
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    first, second = pieces(Mesh(vertices, faces, materials, normals, "m", vertices[:, :2]))
    assert (first.material, second.material) == (2, 4)
    assert first.primitives.tolist() == [1] and second.primitives.tolist() == [0, 2]
    np.testing.assert_array_equal(second.vertices[second.faces], vertices[faces[[0, 2]]])
    np.testing.assert_array_equal(second.uvs, second.vertices[:, :2])
    front, back = two_sides(second, 0.25)
    np.testing.assert_array_equal(front.vertices[front.faces][0], vertices[faces[0]] + [0, 0, 0.25])
    np.testing.assert_array_equal(back.vertices[back.faces][0], vertices[faces[0]][[0, 2, 1]] - [0, 0, 0.25])
    np.testing.assert_array_equal(back.normals, -front.normals)
    assert back.primitives is front.primitives
