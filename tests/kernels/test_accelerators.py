"""List, grid and tree find the same hits, bit for bit, where geometry is at its worst."""

import numpy as np
import pytest

import engines
from engines import Settings

CAMERA = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "resolution": [8, 8]}


def _scene(*shapes):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "set",
            "camera": CAMERA,
            "materials": {"m": {"kd": 0.5}},
            "shapes": [{**shape, "material": "m"} for shape in shapes],
        }
    )


def _mesh(vertices, faces):
    return {"mesh": {"vertices": np.asarray(vertices, float).tolist(), "faces": np.asarray(faces).tolist()}}


def _soup(n, scale=1.0, seed=1):
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-1, 1, (n, 1, 3))
    return _mesh((middle + scale * rng.normal(size=(n, 3, 3))).reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))


def _spheres(n, seed=2):
    rng = np.random.default_rng(seed)
    rows = np.column_stack([rng.uniform(-1, 1, (n, 3)), rng.uniform(0.05, 0.3, n)])
    return [{"sphere": {"center": row[:3].tolist(), "radius": float(row[3])}} for row in rows]


SETS = {
    "one triangle": [_soup(1)],
    "two overlapping triangles": [_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 2]])],
    "a thousand triangles": [_soup(1000, 0.1)],
    "a thousandth beside a million": [
        _mesh([[-1e6, 0, -1e6], [1e6, 0, -1e6], [0, 0, 1e6]], [[0, 1, 2]]),
        _mesh([[0, 0.5, 0], [1e-3, 0.5, 0], [0, 0.501, 0]], [[0, 1, 2]]),
    ],
    "centroids that coincide": [
        _mesh(
            np.concatenate([k * np.array([[1, 0, 0.1], [-0.5, 0.9, 0], [-0.5, -0.9, -0.1]]) for k in range(1, 60)]),
            np.arange(177).reshape(-1, 3),
        )
    ],
    "a flat scene": [_mesh(np.random.default_rng(3).uniform(-1, 1, (300, 3)) * [1, 0, 1], np.arange(300).reshape(-1, 3))],
    "duplicates": [_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 2000)],
    "powers of one half": [
        _mesh(
            np.concatenate([np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]) * 2.0**-k + [2.0**-k, 0, 0] for k in range(40)]),
            np.arange(120).reshape(-1, 3),
        )
    ],
    "triangles, spheres and planes": [
        _soup(100, 0.2),
        *_spheres(30),
        {"plane": {"point": [0, -1, 0], "normal": [0, 1, 0]}},
        _soup(50, 0.3, seed=4),
    ],
    "spheres alone": _spheres(200),
}


def _rays(n=3000, seed=5):
    """Random, axis-aligned (with zeros of both signs) and vertex-aimed rays."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-2, 2, (n, 3))
    directions = rng.normal(size=(n, 3))
    directions[: n // 3, rng.integers(0, 3)] = 0.0
    axis = np.arange(n // 6)
    directions[axis] = np.eye(3)[axis % 3] * np.where(axis % 2, 1.0, -1.0)[:, None]
    directions[axis[::2]] += -0.0
    origins[axis[::3]] = np.round(origins[axis[::3]])
    return origins, directions


@pytest.mark.parametrize(
    ("name", "precision"),
    [*((name, "float64") for name in SETS), *((name, "float32") for name in SETS if name != "spheres alone")],
)
def test_list_grid_and_tree_find_the_same_hits_bit_for_bit(name, precision):
    scene = _scene(*SETS[name])
    origins, directions = _rays()
    hits = {}
    for accelerator in ("none", "grid", "bvh"):
        settings = Settings(8, 8, shader="albedo", accelerator=accelerator, precision=precision)
        renderer = engines.engine("numba").prepare(scene, settings)
        hits[accelerator] = renderer.trace(origins, directions)
        occluded = renderer.occluded(origins, directions)
        assert np.array_equal(occluded, np.isfinite(hits[accelerator].t)), accelerator
    for other in ("grid", "bvh"):
        for field in ("t", "shape", "primitive", "normal", "u", "v"):
            same = np.array_equal(getattr(hits[other], field), getattr(hits["none"], field))
            assert same, f"{other}: {field}"


@pytest.mark.parametrize("name", SETS)
def test_float64_hits_equal_the_references(name):
    scene = _scene(*SETS[name])
    origins, directions = _rays(1500)
    ours = engines.engine("numba").prepare(scene, Settings(8, 8, shader="albedo")).trace(origins, directions)
    theirs = engines.engine("numpy").prepare(scene, Settings(8, 8, shader="albedo")).trace(origins, directions)
    assert np.array_equal(np.isfinite(ours.t), np.isfinite(theirs.t))
    hit = np.isfinite(ours.t)
    assert np.allclose(ours.t[hit], theirs.t[hit], rtol=1e-9)  # which of two coplanar faces wins is a matter of the last bit


def test_ties_go_to_the_lower_shape_then_the_lower_primitive():
    quad = _mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 2], [0, 1, 2]])
    aside = {"sphere": {"center": [9, 0, 0], "radius": 1}}  # with which the code is that of all three kinds
    scene = _scene(quad, quad, {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, aside)
    for accelerator in ("none", "grid", "bvh"):
        renderer = engines.engine("numba").prepare(scene, Settings(8, 8, shader="albedo", accelerator=accelerator))
        hits = renderer.trace([[0.0, 0.0, 3.0]], [[0.0, 0.0, -1.0]])
        assert (hits.shape[0], hits.primitive[0]) == (0, 0)


def test_a_sphere_mesh_far_from_the_origin_has_no_hole():
    """Two hundred rings at (148376, 1234, -223423), seen from within (Woop's own test)."""
    rings, sectors, center = 200, 64, np.array([148376.0, 1234.0, -223423.0])
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, sectors + 1)[:-1], indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1).reshape(-1, 3)
    points = center + 2 * points
    row, column = np.meshgrid(np.arange(rings), np.arange(sectors), indexing="ij")
    a, b = row * sectors + column, row * sectors + (column + 1) % sectors
    faces = np.concatenate([np.stack([a, b, a + sectors], -1), np.stack([b, b + sectors, a + sectors], -1)]).reshape(-1, 3)
    scene = _scene({"mesh": {"vertices": points, "faces": faces}})
    rng = np.random.default_rng(6)
    origins = center + rng.uniform(-0.5, 0.5, (4000, 3))
    aimed = points[rng.integers(0, len(points), 4000)] - origins
    for precision in ("float64", "float32"):
        renderer = engines.engine("numba").prepare(scene, Settings(8, 8, shader="albedo", precision=precision))
        for directions in (aimed, rng.normal(size=(4000, 3))):
            assert np.isfinite(renderer.trace(origins, directions).t).all(), precision


def test_a_grid_of_large_triangles_that_overlap_stays_small():
    scene = _scene(_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 20_000))
    renderer = engines.engine("numba").prepare(scene, Settings(8, 8, shader="albedo", accelerator="grid"))
    assert renderer.counters()["accelerator_bytes"] < 20_000 * 400
    assert renderer.trace([[0.2, 0.2, 1.0]], [[0.0, 0.0, -1.0]]).primitive[0] == 0


def test_a_triangle_without_area_is_never_hit():
    x, z = -1113.45459, -56.2431908
    scene = _scene(_mesh([[x, -79.049614, z], [x, -87.0922699, z], [x, -79.2090149, z]], [[0, 1, 2]]))
    for accelerator in ("none", "grid", "bvh"):
        for precision in ("float32", "float64"):
            settings = Settings(8, 8, shader="albedo", accelerator=accelerator, precision=precision)
            renderer = engines.engine("numba").prepare(scene, settings)
            origin, direction = [-1081.47925, 99.9999542, 87.7701111], [-32.1072998, -183.355865, -144.607635]
            assert np.isinf(renderer.trace([origin], [direction], 0.9999).t).all()
