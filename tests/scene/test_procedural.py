"""Generated shapes: counts, sizes, closed surfaces that face outwards, and the same result every time."""

from __future__ import annotations

import numpy as np
import pytest

from engines.errors import SceneError
from engines.scene import Mesh, SphereSet
from engines.scene.geometry import face_normals
from engines.scene.procedural import GENERATORS
from engines.scene.procedural.sphereflake import sphere_count
from engines.schema.keys import REQUIRED
from tests.scene.generated import is_closed, shape, signed_volume


def test_a_box_is_closed_and_faces_outwards():
    mesh = shape(name="box", half_size=[1, 2, 3], center=[5, 6, 7], rotate_y=33)
    assert isinstance(mesh, Mesh) and mesh.faces.shape == (12, 3) and is_closed(mesh)
    assert signed_volume(mesh) == pytest.approx(48.0)
    middle = mesh.vertices[mesh.faces].mean(axis=1) - [5, 6, 7]
    assert (np.einsum("ij,ij->i", face_normals(mesh.vertices, mesh.faces), middle) > 0).all()


def test_rotate_y_is_right_handed():
    mesh = shape(name="box", half_size=[1, 1, 0.001], rotate_y=90)
    plain = shape(name="box", half_size=[1, 1, 0.001])
    x, y, z = plain.vertices.T
    assert np.allclose(mesh.vertices, np.stack([z, y, -x], axis=1))


def test_a_quad_faces_where_its_corners_turn_counter_clockwise():
    mesh = shape(name="quad", points=[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert (face_normals(mesh.vertices, mesh.faces)[:, 2] > 0).all()
    other = shape(name="rectangle", corner=[0, 0, 0], edge1=[1, 0, 0], edge2=[0, 1, 0])
    assert np.array_equal(other.vertices, mesh.vertices) and np.array_equal(other.faces, mesh.faces)


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_a_tessellated_sphere_is_closed_and_lies_on_the_sphere(subdivisions):
    mesh = shape(name="tessellated_sphere", subdivisions=subdivisions, center=[1, 2, 3], radius=2)
    assert len(mesh.faces) == 20 * 4**subdivisions and len(mesh.vertices) == len(mesh.faces) // 2 + 2
    assert np.allclose(np.linalg.norm(mesh.vertices - [1, 2, 3], axis=1), 2.0)
    assert is_closed(mesh) and 0 < signed_volume(mesh) - 0 < 4 / 3 * np.pi * 8


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_sphereflake_touches_its_parents_and_never_overlaps_the_root(level):
    found = shape(name="sphereflake", level=level, center=[0, 1, 0], radius=0.5)
    assert isinstance(found, SphereSet) and len(found.radii) == sphere_count(level) == sum(9**k for k in range(level + 1))
    distance = np.linalg.norm(found.centers - [0, 1, 0], axis=1)
    assert (distance[1:] > 0.5 * (1 - 1e-12)).all() and found.radii[0] == 0.5
    for index in range(1, len(found.radii)):
        parent = (index - 1) // 9
        gap = np.linalg.norm(found.centers[index] - found.centers[parent]) - found.radii[index] - found.radii[parent]
        assert abs(gap) < 1e-12


def test_the_children_of_a_sphereflake_do_not_touch_each_other():
    found = shape(name="sphereflake", level=1)
    apart = np.linalg.norm(found.centers[1:, None] - found.centers[None, 1:], axis=2) + 9 * np.eye(9)
    assert apart.min() > 2 * found.radii[1]


def test_a_terrain_is_a_heightfield_that_only_the_seed_changes():
    def made(**more):
        return shape(name="terrain", cells=32, size=4, height=1.5, center=[1, 2, 3], **more)

    mesh = made(seed=5)
    assert len(mesh.faces) == 2 * 32 * 32 and (face_normals(mesh.vertices, mesh.faces)[:, 1] > 0).all()
    assert np.allclose(mesh.vertices.min(axis=0), [-1, 2, 1]) and np.allclose(mesh.vertices.max(axis=0), [3, 3.5, 5])
    assert np.array_equal(mesh.vertices, made(seed=5).vertices)
    assert not np.array_equal(mesh.vertices, made(seed=6).vertices)


def test_the_terrain_is_the_same_on_every_machine():
    mesh = shape(name="terrain", cells=4, seed=1)
    assert mesh.vertices[:6, 1] == pytest.approx(HEIGHTS, abs=1e-12)


HEIGHTS = [
    0.9712853072554634,
    1.529962150314147,
    0.9712853072554634,
    0.1354470041859792,
    0.9712853072554634,
    0.7168315188831103,
]


@pytest.mark.parametrize(("p", "q"), [(2, 3), (3, 2), (1, 1), (5, 4)])
def test_a_torus_knot_is_closed_and_faces_outwards(p, q):
    mesh = shape(name="torus_knot", p=p, q=q, segments=400, sides=12, tube=0.05)
    assert len(mesh.faces) == 2 * 400 * 12 and is_closed(mesh) and signed_volume(mesh) > 0
    t = 2 * np.pi * np.arange(400) / 400
    r = np.cos(q * t) + 2
    curve = 0.5 * np.stack([r * np.cos(p * t), r * np.sin(p * t), -np.sin(q * t)], axis=1)
    assert np.allclose(np.linalg.norm(mesh.vertices.reshape(400, 12, 3) - curve[:, None], axis=2), 0.05)


@pytest.mark.parametrize(
    "options",
    [
        {"name": "sphereflake", "level": 12},
        {"name": "tessellated_sphere", "subdivisions": 20},
        {"name": "terrain", "cells": 1 << 20},
        {"name": "torus_knot", "segments": 1 << 24, "sides": 1 << 16},
    ],
)
def test_more_than_the_machine_holds_is_refused_before_allocating(options):
    with pytest.raises(SceneError, match=r"would need .* GiB: this machine has"):
        shape(**options)


def test_every_generator_says_what_its_options_mean():
    for generator in GENERATORS.values():
        assert generator.meaning and all(key.meaning.endswith(".") for key in generator.keys.values())


def test_defaults_alone_make_a_shape():
    for name, generator in GENERATORS.items():
        if all(key.default is not REQUIRED for key in generator.keys.values()):
            assert shape(name=name) is not None
