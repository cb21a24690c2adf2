"""The tree must find what testing everything finds, bit for bit, and must stay shallow whatever the scene."""

import itertools
import time

import numpy as np
import pytest

from engines.numpy_reference.accelerators.bvh_build import build
from engines.scene import Plane, Sphere, SphereSet, Triangle
from tests.numpy_reference.small_scenes import box_mesh, mesh, sphere_mesh, tracer, triangle_soup, unit_rows


def duplicates(count):
    return mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * count)


def line_of_triangles(count, place):
    base = np.array([[0, 0, 0], [0.3, 0, 0.1], [0, 0.4, 0.2]])
    vertices = np.concatenate([base * place(k) + [place(k), 0, 0] for k in range(count)])
    return mesh(vertices, np.arange(3 * count).reshape(-1, 3))


def random_spheres(count, seed=3):
    rng = np.random.default_rng(seed)
    return SphereSet(rng.random((count, 3)), 0.1 * rng.random(count), 0)


TRAP = [
    Triangle((b, 0.0, 0.0), (d, 0.0, 0.0), (d, 1.0, 0.0), 0)
    for b, d in ((25.6, 57.6000022), (25.6, 34.0), (-6.4000024, 57.6000022), (-6.4000024, 57.6000022))
]  # T12
SCENES = {
    "one triangle": [Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)],
    "two overlapping": [duplicates(1), duplicates(1)],
    "a random thousand": [triangle_soup(1000, 0.2)],
    "tiny beside huge": [
        mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * 1e-3, [[0, 1, 2]]),
        mesh(np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]) * 1e6, [[0, 1, 2], [0, 2, 3]]),
    ],
    "equal centres": [
        mesh(
            np.concatenate([k * np.array([[1, 0, -1], [-1, 1, 0], [0, -1, 1]]) for k in range(1, 60)]),
            np.arange(177).reshape(-1, 3),
        )
    ],
    "all on a line": [line_of_triangles(200, float)],
    "two thousand duplicates": [duplicates(2000)],
    "flat": [
        mesh(
            [[x - 5, y, 0] for x in range(12) for y in range(12)],
            [[12 * x + y, 12 * x + y + 12, 12 * x + y + 13] for x in range(11) for y in range(11)],
        )
    ],
    "spheres, planes and meshes": [
        random_spheres(50),
        Plane((0.0, -0.5, 0.0), (0.0, 1.0, 0.0), 0),
        sphere_mesh(12, (0.5, 0.5, 0.5), 0.4),
        Sphere((0.2, 0.2, 0.2), 0.3, 0),
        Plane((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), 0),
        random_spheres(50),
    ],
    "a box": [box_mesh()],
    "coplanar boxes": [box_mesh(), box_mesh(), box_mesh((-2.0, -2.0, -1.0), (0.5, 0.5, 1.0))],
    "the trap of the surface-area heuristic": TRAP,
    "powers of one half": [line_of_triangles(300, lambda k: 2.0**-k)],
}


def rays(shapes):
    """Random ones, ones along the axes through grid points, and ones at the corners of triangles."""
    rng = np.random.default_rng(0)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    axes = np.concatenate([axes, np.where(axes == 0, -0.0, axes), np.where(axes == 0, 1e-40, axes)])
    grid = np.array(list(itertools.product((-1.0, 0.0, 0.25, 1.0, 3.0), repeat=3)))
    parts = [
        (4.0 * rng.random((1500, 3)) - 1.5, rng.normal(size=(1500, 3))),
        (np.repeat(grid, len(axes), axis=0), np.tile(axes, (len(grid), 1))),
    ]
    meshes = [shape for shape in shapes if hasattr(shape, "faces")]
    corners = np.concatenate([shape.vertices[shape.faces[:500]].reshape(-1, 3) for shape in meshes] or [grid])
    origins = 4.0 * rng.random((1500, 3)) - 1.5
    parts.append((origins, corners[rng.integers(len(corners), size=1500)] - origins))
    return (np.concatenate(part) for part in zip(*parts, strict=True))


@pytest.mark.parametrize(
    ("name", "leaf_size"),
    [(name, size) for name in SCENES for size in (1, 4) if (name, size) != ("two thousand duplicates", 1)],  # seconds
)
def test_the_tree_finds_the_same_hits_bit_for_bit(name, leaf_size):  # A1, T11, T12, T13
    shapes = SCENES[name]
    origins, directions = rays(shapes)
    if name == "two thousand duplicates":
        origins, directions = origins[::100], directions[::100]
    every, tree = tracer(*shapes), tracer(*shapes, accelerator={"name": "bvh", "leaf_size": leaf_size})
    for reach in (np.inf, 0.7):
        expected, found = every.trace(origins, directions, reach), tree.trace(origins, directions, reach)
        for field in ("t", "shape", "primitive", "normal", "u", "v"):
            assert np.array_equal(getattr(expected, field), getattr(found, field)), field
        dark = expected.shape >= 0
        assert np.array_equal(every.occluded(origins, directions, reach), dark)
        assert np.array_equal(tree.occluded(origins, directions, reach), dark)


def test_of_equal_hits_the_lowest_primitive_wins():  # T11
    for accelerator in ("none", "bvh"):
        hits = tracer(duplicates(300), duplicates(300), accelerator=accelerator).trace([(0.2, 0.2, 1)], [(0, 0, -1)])
        assert (hits.shape[0], hits.primitive[0]) == (0, 0)


def test_of_equal_hits_of_different_kinds_the_lower_shape_wins():
    plane = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)
    triangle = Triangle((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0), 0)
    sphere = Sphere((0.0, 0.0, -1.0), 1.0, 0)
    for order in itertools.permutations([plane, triangle, sphere]):
        for accelerator in ("none", "bvh"):
            hits = tracer(*order, accelerator=accelerator).trace([(0.0, 0.0, 1.0)], [(0.0, 0.0, -1.0)])
            assert hits.shape[0] == 0 and hits.t[0] == 1.0


@pytest.mark.parametrize(
    "centers",
    [2.0 ** -np.arange(1000.0), np.zeros(1000), np.arange(1000.0), np.random.default_rng(0).random(1000)],
    ids=["powers of one half", "all equal", "evenly spaced", "random"],
)  # A4
def test_no_scene_makes_the_tree_deep_or_loses_a_primitive(centers):
    low = np.stack([centers, np.zeros(1000), np.zeros(1000)])
    tree = build(low, low + 0.1 * centers, 2)
    assert tree.depth <= 60
    held = np.sort(tree.leaves[tree.leaves < 1000])
    assert np.array_equal(held, np.arange(1000))


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_rays_in_the_faces_and_edges_of_a_flat_grid_find_it(accelerator):
    """The box around the grid has no height: its slab must be met by rays that lie in it or touch it."""
    grid = SCENES["flat"][0]
    targets = grid.vertices + 0.25
    targets = targets[(targets[:, 0] < 5.9) & (targets[:, 1] < 10.9) & (targets[:, 1] > 0.1)]
    targets[:, 1] -= 0.2  # below the diagonal of the cell: inside a triangle
    targets[:, 2] = 0.0
    for direction in ((0.0, 0.0, -1.0), (-0.0, -0.0, -1.0), (1e-40, -1e-40, -1.0)):
        above = targets + np.array([0.0, 0.0, 2.0])
        hits = tracer(grid, accelerator=accelerator).trace(above, np.tile(direction, (len(targets), 1)))
        assert (hits.t == 2.0).all()


def test_a_hundred_thousand_triangles_are_no_trouble():
    fine = sphere_mesh(160)
    begin = time.process_time()
    tree = tracer(fine, accelerator="bvh")
    assert len(fine.faces) > 100_000 and time.process_time() - begin < 30.0
    assert tree.counters()["accelerator_bytes"] > 0
    hits = tree.trace(np.zeros((5000, 3)), unit_rows(np.random.default_rng(1).normal(size=(5000, 3))))
    assert np.abs(hits.t - 1.0).max() < 1e-3
