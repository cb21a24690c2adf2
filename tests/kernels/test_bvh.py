"""The tree itself: every primitive in one leaf, boxes that hold what is below them, and the same bytes by any threads."""

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


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_every_primitive_is_in_one_leaf_and_every_box_holds_what_is_below(real):
    flat = flat_scene(4, spheres=700, real=real)
    nodes, leaves = built(flat)
    words, found = nodes.view(np.int32), []

    def check(node, low, high):
        for slot in range(8):
            child = int(words[node, CHILDREN + slot])
            if child == NOTHING:
                continue
            below, above = nodes[node, slot:24:8], nodes[node, 24 + slot : 48 : 8]
            assert (below >= low).all() and (above <= high).all()
            if child >= 0:
                check(child, below, above)
                continue
            ids, lower, upper = leaf_boxes(flat, leaves, child)
            assert (lower > below).all() and (upper < above).all()
            found.extend(ids.tolist())

    check(0, np.full(3, -np.inf), np.full(3, np.inf))
    assert sorted(found) == list(range(20 * 4**4 + 700))
    assert nodes.shape[1] == NODE_WORDS


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


def test_leaves_are_full_and_wide_nodes_too():
    nodes, _ = built(flat_scene(6))
    children = nodes.view(np.int32)[:, CHILDREN : CHILDREN + 8]
    leaves = children[(children < 0) & (children != NOTHING)]
    assert (((-1 - leaves) & 7) + 1).sum() == 81920
    assert 81920 / len(leaves) > 5
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
