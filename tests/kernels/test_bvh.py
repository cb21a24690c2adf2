"""The tree itself: every primitive in its leaves, boxes that hold what is below them, and the same bytes by any threads."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines.errors import Unsupported
from engines.kernels.flatten import flatten
from engines.kernels.layout import SceneTable
from engines.numba_cpu.accel.bvh import Accelerator
from engines.numba_cpu.accel.bvh_build import DEEPEST, SPHERES
from engines.numba_cpu.accel.bvh_collapse import CHILDREN, NODE_WORDS, NOTHING
from engines.numba_cpu.accel.bvh_leaves import stride
from engines.numba_cpu.accel.bvh_walk import BvhTable
from engines.scene import Mesh

CAMERA = {"type": "perspective", "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "resolution": [8, 8]}


def flat_scene(subdivisions, spheres=0, real=np.float32):
    rng = np.random.default_rng(3)
    mesh = {"procedural": {"name": "tessellated_sphere", "subdivisions": subdivisions}, "material": "m"}
    more = [
        {"sphere": {"center": row[:3].tolist(), "radius": float(abs(row[3])) / 50 + 0.01}, "material": "m"}
        for row in rng.normal(size=(spheres, 4))
    ]
    scene = engines.scene_from(
        {"raybench_scene": 1, "camera": CAMERA, "materials": {"m": {"kd": 0.5}}, "shapes": [mesh, *more]}
    )
    return flatten(scene, real, real)


def built(flat, threads=1):
    accelerator = Accelerator({})
    accelerator.build(flat, threads)
    return flat.arrays[BvhTable.nodes], flat.arrays[BvhTable.leaves]


def leaf_boxes(flat, leaves, code):
    """(ids, lower corners, upper corners) of the primitives of a leaf, read from its bytes."""
    first, kind, n = (-1 - code) >> 5, ((-1 - code) >> 3) & 3, ((-1 - code) & 7) + 1
    data, size = leaves[first * stride(flat.real) :].tobytes(), np.dtype(flat.real).itemsize
    row_bytes = n * (32 if kind == SPHERES else 9 * size)
    ids = np.frombuffer(data[row_bytes : row_bytes + 4 * n], np.int32)
    if kind == SPHERES:
        rows = np.frombuffer(data[:row_bytes], np.float64).reshape(4, n).T
        return ids, rows[:, :3] - rows[:, 3:], rows[:, :3] + rows[:, 3:]
    corners = np.frombuffer(data[:row_bytes], flat.real).reshape(3, 3, n).transpose(2, 0, 1)
    return ids, corners.min(axis=1), corners.max(axis=1)


def boxes_of_primitives(flat, nodes, leaves):
    """(id, lower corner, upper corner) of the box of each leaf that holds a primitive; boxes hold what is below them."""
    words, found = nodes.view(np.int32), []

    def visit(node, low, high):
        for slot in range(8):
            child = int(words[node, CHILDREN + slot])
            if child == NOTHING:
                continue
            below, above = nodes[node, slot:24:8], nodes[node, 24 + slot : 48 : 8]
            assert (below >= low).all() and (above <= high).all()
            if child >= 0:
                visit(child, below, above)
            else:
                found.extend((int(each), below, above) for each in leaf_boxes(flat, leaves, child)[0])

    visit(0, np.full(3, -np.inf), np.full(3, np.inf))
    return found


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_every_point_of_a_triangle_and_of_a_sphere_is_in_a_leaf(real):
    """A large triangle is in several leaves, each of which has a part of it."""
    flat = flat_scene(4, spheres=700, real=real)
    nodes, leaves = built(flat)
    held = {}
    for primitive, below, above in boxes_of_primitives(flat, nodes, leaves):
        held.setdefault(primitive, []).append((below.astype(np.float64), above.astype(np.float64)))
    triangles = flat.arrays[SceneTable.vertices][flat.arrays[SceneTable.triangles]].astype(np.float64)
    assert sorted(held) == list(range(len(triangles) + 700))
    assert len(triangles) < sum(map(len, held.values())) - 700 <= 1.3 * len(triangles)
    weights = np.random.default_rng(5).dirichlet(np.ones(3) / 2, 20)
    for primitive, corners in enumerate(triangles):
        points = np.vstack([corners, weights @ corners])
        inside = [((points > below) & (points < above)).all(axis=1) for below, above in held[primitive]]
        assert np.any(inside, axis=0).all()
    for k, (*center, radius) in enumerate(flat.arrays[SceneTable.spheres]):
        directions = np.random.default_rng(k).normal(size=(20, 3))
        points = np.array(center) + radius * directions / np.linalg.norm(directions, axis=1)[:, None]
        inside = [((points > below) & (points < above)).all(axis=1) for below, above in held[len(triangles) + k]]
        assert np.any(inside, axis=0).all()
    assert nodes.shape[1] == NODE_WORDS


def flat_triangles(corners):
    """A flat scene of triangles (n, 3, 3)."""
    scene = engines.scene_from({"raybench_scene": 1, "camera": CAMERA, "materials": {"m": {"kd": 0.5}}, "shapes": []})
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    mesh = Mesh(corners.reshape(-1, 3), faces, np.zeros(len(faces), np.int32))
    return flatten(replace(scene, shapes=(mesh,)), np.float64, np.float64)


@pytest.mark.parametrize("n", range(1, 12))
def test_each_of_a_few_triangles_is_in_one_leaf(n):
    """One leaf of all of them is the whole tree up to eight."""
    apart = np.random.default_rng(n).normal(size=(n, 3, 3)) + 10 * np.arange(n)[:, None, None]
    flat = flat_triangles(apart)
    assert sorted(primitive for primitive, _, _ in boxes_of_primitives(flat, *built(flat))) == list(range(n))


def test_rays_meet_the_same_in_a_tree_that_is_built_fast():
    scene = engines.load_scene("living_room")
    low, high = np.array([-2.0, 0.1, -2.0]), np.array([2.0, 2.4, 2.0])
    directions = np.random.default_rng(4).normal(size=(2000, 3))
    hits = [
        engines.engine("numba")
        .prepare(scene, engines.Settings(8, 8, accelerator={"name": "bvh", "quality": quality}, precision="float32"))
        .trace(np.linspace(low, high, 2000), directions)
        for quality in ("fast", "high")
    ]
    assert np.array_equal(hits[0].t, hits[1].t) and np.array_equal(hits[0].primitive, hits[1].primitive)
    assert np.isfinite(hits[0].t).mean() > 0.9


def test_long_triangles_that_lie_aslant_are_cut_in_parts():
    slant = np.array([[-1.0, -1, -1], [1, 1, -1], [-1, 1, 1]])
    small = 1e-3 * np.random.default_rng(2).normal(size=(400, 3, 3)) + np.random.default_rng(3).uniform(-0.9, 0.9, (400, 1, 3))
    flat = flat_triangles(np.vstack([slant[None], small]))
    found = [primitive for primitive, _, _ in boxes_of_primitives(flat, *built(flat))]
    assert found.count(0) > 5
    assert all(found.count(k) == 1 for k in range(1, 401))


@pytest.mark.parametrize(
    "sizes",
    [np.ones(20_000), 2.0 ** -np.arange(120.0), 2.0 ** np.linspace(0, -100, 5000)],
    ids=["one triangle again and again", "each half as far as the last", "many at every scale"],
)
def test_no_scene_makes_the_tree_deep(sizes):
    corners = sizes[:, None, None] * np.array([[1.0, 0, 0], [1.0, 0.5, 0], [1.0, 0, 0.5]])
    scene = engines.scene_from({"raybench_scene": 1, "camera": CAMERA, "materials": {"m": {"kd": 0.5}}, "shapes": []})
    mesh = Mesh(
        corners.reshape(-1, 3), np.arange(3 * len(sizes), dtype=np.int32).reshape(-1, 3), np.zeros(len(sizes), np.int32)
    )
    nodes, _ = built(flatten(replace(scene, shapes=(mesh,)), np.float64, np.float64))
    depth, level = 0, [0]
    while level:
        depth += 1
        level = [
            int(child)
            for child in nodes.view(np.int32)[level, CHILDREN : CHILDREN + 8].ravel()
            if child >= 0 and child != NOTHING
        ]
    assert depth <= DEEPEST + np.log2(len(sizes)) + 1


@pytest.mark.parametrize("spheres", [0, 700])
def test_two_threads_build_the_same_bytes_as_one(spheres):
    flat = flat_scene(6, spheres=spheres)
    one = [array.copy() for array in built(flat, threads=1)]
    for _ in range(3):
        for ours, theirs in zip(built(flat, threads=2), one, strict=True):
            assert ours.tobytes() == theirs.tobytes()


def test_building_takes_less_than_250_bytes_a_triangle():
    flat = flat_scene(6)
    built(flat)  # compiles
    n = len(flat.arrays[SceneTable.triangles])
    tracemalloc.start()
    built(flat, threads=2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 250 * n
    assert flat.arrays[SceneTable.vertices].size and not flat.arrays[SceneTable.spheres].size


def boxes_in_leaves(nodes):
    """How many boxes each leaf has."""
    children = nodes.view(np.int32)[:, CHILDREN : CHILDREN + 8]
    leaves = children[(children < 0) & (children != NOTHING)]
    return ((-1 - leaves) & 7) + 1


def test_leaves_are_full_and_wide_nodes_too():
    nodes, _ = built(flat_scene(6))
    children, boxes = nodes.view(np.int32)[:, CHILDREN : CHILDREN + 8], boxes_in_leaves(nodes)
    assert 81920 <= boxes.sum() < 1.1 * 81920
    assert boxes.mean() > 5
    assert (children != NOTHING).sum(axis=1).mean() > 6.5


def test_a_scene_of_a_septillion_metres_is_met_along_the_axes():
    rng = np.random.default_rng(8)
    vertices = 1e24 * (rng.uniform(-1, 1, (200, 1, 3)) + 0.2 * rng.normal(size=(200, 3, 3))).reshape(-1, 3)
    origins = 1e24 * rng.uniform(-2, 2, (300, 3))
    directions = np.eye(3)[np.arange(300) % 3] * np.where(np.arange(300) % 2, 1.0, -1.0)[:, None]
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": CAMERA,
            "materials": {"m": {"kd": 0.5}},
            "shapes": [{"mesh": {"vertices": vertices, "faces": np.arange(600).reshape(-1, 3)}, "material": "m"}],
        }
    )
    hits = [
        engines.engine("numba")
        .prepare(scene, engines.Settings(8, 8, shader="albedo", accelerator=name))
        .trace(origins, directions)
        for name in ("none", "bvh")
    ]
    assert 10 < np.isfinite(hits[0].t).sum() < 290
    assert np.array_equal(hits[0].t, hits[1].t)


def test_a_scene_too_large_for_boxes_in_float32_is_refused():
    vertices = 1e200 * np.random.default_rng(9).uniform(-1, 1, (600, 3))
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": CAMERA,
            "materials": {"m": {"kd": 0.5}},
            "shapes": [{"mesh": {"vertices": vertices, "faces": np.arange(600).reshape(-1, 3)}, "material": "m"}],
        }
    )
    with pytest.raises(Unsupported, match="of at most 1e"):
        engines.engine("numba").prepare(scene, engines.Settings(8, 8, shader="albedo", accelerator="bvh"))
