"""Embree's hits are confirmed in float64: what the triangle does not confirm is no hit, and hides nothing."""

import numpy as np
import pytest

from engines import Settings
from engines.embree.packet import EmbreeTable
from engines.registry import engine
from engines.scene import scene_from
from harness.trace import oracle
from harness.verify.scenes import mesh, normalize, scene

N = 100


def needles():
    """Corners (n, 3, 3) of triangles 1e-4 thin, and rays that pass beside most of them, almost in their planes."""
    rng = np.random.default_rng(18)
    a, along = rng.uniform(-1, 1, (N, 3)), normalize(rng.normal(size=(N, 3)))
    aside = normalize(np.cross(along, rng.normal(size=(N, 3))))
    corners = np.stack([a, a + along, a + 0.5 * along + 1e-4 * aside], 1)
    target = corners.mean(axis=1) + aside * rng.normal(size=(N, 1)) * 1e-4
    out = 1e-3 * rng.normal(size=(N, 1)) * np.cross(along, aside)
    directions = normalize(aside + out + 0.3 * rng.normal(size=(N, 1)) * along)
    return (part.astype(np.float32).astype(float) for part in (corners, target - 3 * directions, directions))


def found(refine):
    """For rays that miss their needle: which shape is hit (1: a wall behind), and what `occluded` says before the wall."""
    corners, origins, directions = needles()
    exact = oracle.triangle(corners[:, 0], corners[:, 1], corners[:, 2], origins, directions)
    _, u, v = (np.asarray(part, np.float64) for part in exact)
    shapes, dark = [], []
    for i in np.flatnonzero(np.minimum(np.minimum(u, v), 1 - u - v) < -1e-9):
        o, d = origins[i : i + 1], directions[i : i + 1]
        aside = normalize(np.cross(d[0], (0.6, 0.0, 0.8)))
        up = np.cross(aside, d[0])
        wall = o[0] + 8 * d[0] + 9 * np.array([-aside - up, aside - up, up])
        held = scene([mesh(corners[i], [[0, 1, 2]]), mesh(wall, [[0, 1, 2]])])
        accelerator = {"name": "embree", "refine": refine}
        renderer = engine("embree").prepare(held, Settings(precision="float64", accelerator=accelerator))
        shapes.append(renderer.trace(o, d).shape[0])
        dark.append(renderer.occluded(o, d, 7.0)[0])
    return np.array(shapes), np.array(dark)


def test_a_false_hit_is_dropped_and_what_it_hid_is_found():
    shapes, dark = found(refine=True)
    assert len(shapes) > 50 and (shapes == 1).all() and not dark.any()


def test_without_refinement_embree_reports_needles_that_are_missed():
    shapes, dark = found(refine=False)
    assert (shapes == 0).any() and dark.any()


def closed_sphere(rows=24, columns=48):
    """Vertices and faces of a sphere of radius 2, far from the origin; all edges are shared by two faces."""
    theta, phi = np.pi * np.arange(1, rows) / rows, 2 * np.pi * np.arange(columns) / columns
    sine, cosine = np.sin(theta)[:, None], np.repeat(np.cos(theta)[:, None], columns, axis=1)
    ring = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.indices((rows - 2, columns)))
    a, b, here = i * columns + j, i * columns + (j + 1) % columns, np.arange(columns)
    top, bottom, after = np.full(columns, len(ring)), np.full(columns, len(ring) + 1), (here + 1) % columns
    last = len(ring) - columns
    faces = [(a, a + columns, b + columns), (a, b + columns, b), (top, here, after), (bottom, last + after, last + here)]
    poles = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    return FAR + 2.0 * np.vstack([ring, poles]), np.hstack(faces).T


FAR = np.array([51234.0, -777.0, 9123.0])
WATERTIGHT = {"name": "embree", "watertight": True}


@pytest.mark.parametrize(
    ("name", "precision", "accelerator", "n"),
    [
        ("numpy", "float64", "bvh", 2000),
        ("numba", "float32", "bvh", 20_000),
        ("numba", "float64", "bvh", 20_000),
        ("embree", "float32", WATERTIGHT, 20_000),
        ("embree", "float64", WATERTIGHT, 20_000),
    ],
)
def test_nothing_leaves_a_closed_sphere_at_its_vertices_and_edges(name, precision, accelerator, n):
    """Embree's own triangles let 20 of 20,000 rays at vertices pass."""
    vertices, faces = closed_sphere()
    rng = np.random.default_rng(1)
    origins = FAR + 1.8 * normalize(rng.normal(size=(n, 3))) * rng.random((n, 1)) ** (1 / 3)
    corners = vertices[faces[rng.integers(len(faces), size=n)]]
    along = rng.random((n, 1)) * (rng.random((n, 1)) < 0.3)  # most of them at vertices
    ways = corners[:, 0] * (1 - along) + corners[:, 1] * along - origins
    settings = Settings(precision=precision, accelerator=accelerator)
    renderer = engine(name).prepare(scene([mesh(vertices, faces)]), settings)
    assert np.isfinite(renderer.trace(origins, ways).t).all() and renderer.occluded(origins, ways).all()


@pytest.mark.parametrize("scale", [1e-20, 1.0, 1e18])
def test_shadows_are_seen_at_every_scale(scale):
    wall = mesh(scale * np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]])
    renderer = engine("embree").prepare(scene([wall]), Settings(precision="float64"))
    origins = scale * np.array([[0.0, 0, 1], [3.0, 0, 1]])
    reach = [[1.001 * scale] * 2, [0.999 * scale] * 2]
    assert [renderer.occluded(origins, [[0, 0, -1]] * 2, far).tolist() for far in reach] == [[True, False], [False, False]]


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_rays_one_by_one_see_what_packets_see(precision):
    """Trees large and small take different ways; a path that leaves a face must not meet it again on either."""
    faces = {"procedural": {"name": "tessellated_sphere", "subdivisions": 3}, "material": "white"}
    scene = scene_from(
        {
            "raybench_scene": 1,
            "camera": {
                "type": "perspective",
                "eye": [0, 0, 4],
                "target": [0, 0, 0],
                "up": [0, 1, 0],
                "fov": 40,
                "resolution": [24, 24],
            },
            "materials": {"white": {"kd": 0.5}},
            "shapes": [faces, {"sphere": {"center": [0, 0, 2], "radius": 0.3}, "material": "white"}],
            "lights": [{"point": {"position": [2, 3, 4], "intensity": 20}}],
        }
    )
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(1000, 3))
    ways = rng.uniform(-1, 1, (1000, 3)) - origins
    seen = []
    for large in (0, 1):
        settings = Settings(precision=precision, sampler="sobol", threads=1)
        renderer = engine("embree").prepare(scene, settings)
        renderer._flat.bind(EmbreeTable.one_by_one, large)
        hits = renderer.trace(origins, ways)
        seen.append((hits.t, hits.primitive, renderer.occluded(origins, ways), renderer.render(2).mean()))
    (t, primitive, hidden, image), (t1, primitive1, hidden1, image1) = seen
    same = primitive == primitive1  # on an edge either face may be taken
    assert same.mean() > 0.99 and np.array_equal(t[same], t1[same])
    assert np.array_equal(np.isfinite(t), np.isfinite(t1)) and np.array_equal(hidden, hidden1)
    assert 0.3 < hidden.mean() < 0.95 and np.mean(np.abs(image - image1)) < 1e-3 * image.mean()
