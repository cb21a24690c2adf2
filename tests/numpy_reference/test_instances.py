"""Instances: what rays find in turned groups is what they find in the flattened scene."""

import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from engines import Settings, engine, scene_from
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.vectors import EPSILON
from engines.scene import Instance, Mesh, flattened

CAMERA = {"type": "perspective", "eye": [0, 1, 9], "target": [0, 0, 0], "fov": 40, "resolution": [12, 12]}
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
MATRICES = {
    "turned": np.column_stack([TURN, [-1.5, 0, 0]]),
    "twice as large": np.column_stack([2 * TURN, [1.5, 0.5, -1]]),
    "mirrored": np.column_stack([TURN * [1, 1, -1], [0, -1.5, 1]]),
    "mirrored and stretched": np.column_stack([TURN @ np.diag([0.5, -1.5, 1.0]) @ TURN.T, [0.5, 1.5, 0]]),
    "sheared": np.array([[1.0, 0.7, 0, 1], [0, 0.8, 0.3, -1], [0, 0, -1.2, 0.5]]),
}
SIMILAR = ("turned", "twice as large", "mirrored")


def bumpy(count=150, seed=5, **more):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) + rng.normal(size=(count, 3, 3)) * 0.5
    return {"mesh": {"vertices": corners.reshape(-1, 3), "faces": np.arange(3 * count).reshape(-1, 3), **more}}


ROUND = (
    {"sphere": {"center": [0.2, 0.1, 0], "radius": 0.7}},
    {"spheres": {"centers": [[1, 0, 0], [0, 1, 0.5]], "radii": [0.4, 0.3]}},
    {"disk": {"center": [-0.5, 0, 0.5], "normal": [0.3, 0.2, 1], "radius": 0.8}},
    {"cylinder": {"p0": [-1, -1, 0], "p1": [0.5, -0.5, 0.3], "radius": 0.3}},
)
TRIANGLE = {"triangle": {"a": [-1, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}}


def made(group, matrices, before=(), materials=None, **more):
    """A scene of the shapes `before`, and of an instance for each matrix."""
    shapes = [*({"material": "grey", **shape} for shape in before)]
    shapes += [{"instance": {"group": "g", "matrix": matrix}} for matrix in matrices]
    groups = {"g": [{"material": "grey", **shape} for shape in group]}
    scene = {"raybench_scene": 1, "camera": CAMERA, "materials": {"grey": {"kd": 0.5}, **(materials or {})}}
    return scene_from({**scene, "groups": groups, "shapes": shapes, "lights": [{"environment": {"radiance": 1}}], **more})


def rays(count=3000, seed=2):
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * 4
    return origins, rng.normal(size=(count, 3)) - 0.3 * origins


def renderer(scene, accelerator="auto", **more):
    return engine("numpy").prepare(scene, Settings(accelerator=accelerator, **more))


def numbered(scene, flat, hits):
    """Instances and their primitives of hits in the flattened scene."""
    shapes, firsts = [], []
    for index, shape in enumerate(scene.shapes):
        members = shape.group.shapes if isinstance(shape, Instance) else [shape]
        first = 0
        for member in members:
            shapes.append(index)
            firsts.append(first)
            first += len(getattr(member, "faces", getattr(member, "radii", [0])))
    assert len(shapes) == len(flat.shapes)
    found = hits.shape >= 0
    shape = np.where(found, np.array(shapes)[hits.shape], -1)
    return shape, np.where(found, np.array(firsts)[hits.shape] + hits.primitive, -1)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
@pytest.mark.parametrize("what", MATRICES)
def test_rays_find_in_an_instance_of_triangles_what_they_find_in_its_copy(what, accelerator):
    matrix, group = MATRICES[what], [TRIANGLE, bumpy(), bumpy(60, 6)]
    scene = made(group, [matrix, MATRICES["turned"]], before=[bumpy(40, 7), ROUND[0]])
    flat = flattened(scene)
    origins, directions = rays()
    found, truth = (renderer(each, accelerator).trace(origins, directions) for each in (scene, flat))
    shape, primitive = numbered(scene, flat, truth)
    assert (found.shape >= 2).mean() > 0.2 and np.array_equal(found.shape, shape) and np.array_equal(found.primitive, primitive)
    hit = shape >= 0
    assert found.t[hit] == pytest.approx(truth.t[hit], rel=1e-12) and np.isinf(found.t[~hit]).all()
    assert found.normal == pytest.approx(truth.normal, abs=1e-12)
    swapped = (shape == 2) & (np.linalg.det(matrix[:, :3]) < 0)
    for ours, theirs in ((found.u, np.where(swapped, truth.v, truth.u)), (found.v, np.where(swapped, truth.u, truth.v))):
        assert ours == pytest.approx(theirs, abs=1e-9)
    dark = renderer(scene, accelerator).occluded(origins, directions)
    assert np.array_equal(dark, hit)


@pytest.mark.parametrize("what", SIMILAR)
def test_rays_find_in_an_instance_of_round_shapes_what_they_find_in_its_copy(what):
    scene = made(ROUND, [MATRICES[what]], before=[TRIANGLE])
    flat = flattened(scene)
    assert not any(isinstance(shape, Mesh) for shape in flat.shapes)
    found, truth = (renderer(each).trace(*rays()) for each in (scene, flat))
    shape, primitive = numbered(scene, flat, truth)
    assert (shape == 1).sum() > 150 and np.array_equal(found.shape, shape) and np.array_equal(found.primitive, primitive)
    hit = shape >= 0
    assert found.t[hit] == pytest.approx(truth.t[hit], rel=1e-10)
    assert found.normal == pytest.approx(truth.normal, abs=1e-9)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
@pytest.mark.parametrize("what", MATRICES)
def test_a_stretched_sphere_is_an_ellipsoid(what, accelerator):
    matrix, center, radius = MATRICES[what], np.array([0.2, 0.1, 0]), 0.7
    origins, directions = rays()
    inverse = np.linalg.inv(matrix[:, :3])
    o, d = (origins - matrix[:, 3]) @ inverse.T - center, directions @ inverse.T
    a, b, c = (d * d).sum(1), (o * d).sum(1), (o * o).sum(1) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    near, far = (-b - root) / a, (-b + root) / a
    t = np.where(near > 0, near, far)
    hit = (b * b > a * c) & (t > 0)
    found = renderer(made(ROUND[:1], [matrix]), accelerator).trace(origins, directions)
    assert hit.mean() > 0.02 and np.array_equal(found.shape >= 0, hit)
    assert found.t[hit] == pytest.approx(t[hit], rel=1e-9)
    normal = ((o + t[:, None] * d) @ inverse)[hit]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign((normal * directions[hit]).sum(1, keepdims=True))
    assert found.normal[hit] == pytest.approx(normal, abs=1e-7)


def test_both_accelerators_give_the_same_bits():
    scene = made([bumpy(), *ROUND], MATRICES.values(), before=[bumpy(40, 7)])
    listed, tree = (renderer(scene, name).trace(*rays()) for name in ("none", "bvh"))
    for name in ("t", "shape", "primitive", "normal", "u", "v"):
        assert np.array_equal(getattr(listed, name), getattr(tree, name)), name


def test_rays_that_meet_more_boxes_than_are_looked_at_together_find_the_same(monkeypatch):
    scene = made([bumpy(5)], [matrix for matrix in MATRICES.values() for _ in range(3)])
    whole = renderer(scene, "bvh").trace(*rays(100))
    monkeypatch.setattr("engines.numpy_reference.accelerators.turned.PAIRS", 200)
    for name in ("none", "bvh"):
        part = renderer(scene, name).trace(*rays(100))
        assert np.array_equal(part.t, whole.t) and np.array_equal(part.shape, whole.shape)


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_of_equal_distances_the_lowest_shape_and_primitive_win(accelerator):
    same = np.eye(3, 4)
    for before in (0, 2):
        scene = made([TRIANGLE, TRIANGLE], [same] * 3, before=[{"sphere": {"center": [9, 9, 9], "radius": 1}}] * before)
        hits = renderer(scene, accelerator).trace([0, 0.3, 5], [0, 0, -1])
        assert (hits.shape[0], hits.primitive[0], hits.t[0]) == (before, 0, 5.0)
    behind = made([TRIANGLE], [same], before=[TRIANGLE])
    before = replace(behind, shapes=behind.shapes[::-1])
    for scene in (behind, before):
        assert renderer(scene, accelerator).trace([0, 0.3, 5], [0, 0, -1]).shape[0] == 0


def test_a_ray_that_has_left_a_triangle_of_an_instance_meets_the_same_one_of_another_instance():
    below, above = np.eye(3, 4), np.column_stack([np.eye(3), [0, 0, 1]])
    context = renderer(made([TRIANGLE, TRIANGLE], [below, above]))._context
    for left, met in ((-1, 2), (0, 2), (2, 3), (3, 2)):
        hits = context.closest(np.array([[0], [0.3], [1.001]]), np.array([[0.0], [0], [-1]]), np.array([left]))
        assert hits.primitive_id[0] == met


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_offsets_of_an_instance_are_in_the_units_of_the_world(scale):
    context = renderer(made([TRIANGLE], [np.eye(3, 4) * scale]))._context
    origin, direction = np.array([[0], [0.3 * scale], [1.0]]), np.array([[0.0], [0], [-1]])
    at = context.surface(origin, direction, context.closest(origin, direction))
    assert 0.3 * scale <= at.offset[0] / (256 * EPSILON) <= 2 * max(scale, 1.0)


def test_offsets_grow_where_the_matrix_is_ill_conditioned():
    """A place in the world is in the group's coordinates |M| |M^-1| as far off, at most."""
    matrix = np.column_stack([TURN @ np.diag([1, 1, 1e-4]) @ TURN.T, np.zeros(3)])
    scene = made([{"triangle": {"a": [-5, -5, 0], "b": [5, -5, 0], "c": [0, 9, 0]}}], [matrix])
    context, outward = renderer(scene)._context, np.linalg.inv(matrix[:, :3])[2]
    target, outward = matrix[:, :3] @ [0.1, 0.2, 0], outward / np.linalg.norm(outward)
    origin, direction = (target + outward)[:, None], -outward[:, None]
    at = context.surface(origin, direction, context.closest(origin, direction))
    growth = np.abs(matrix[:, :3]) @ np.abs(np.linalg.inv(matrix[:, :3])) @ np.abs(target)
    assert growth.max() > 400 and at.offset[0] / (256 * EPSILON) == pytest.approx(growth.max())


def seen(scene, **shader):
    film = renderer(scene, shader={"name": "path_tracer", "max_depth": 4, **shader}, sampler="random").render(2)
    assert film.bad_samples == 0
    return film.mean()


COLOURS = np.random.default_rng(9).random((450, 3))
UVS = np.random.default_rng(8).random((450, 2))
TEXTURES = {
    "squares": {"checkerboard": {"a": 0.1, "b": 0.8}, "scale": [7, 5]},
    "waves": {"checkerboard": {"a": 0, "b": 1}, "scale": [3, 4]},
    "colours": {"attribute": "vertex_color"},
}
LOOKS = {
    "texture": {"diffuse": {"reflectance": "squares"}},
    "vertex colours": {"diffuse": {"reflectance": "colours"}},
    "mask": {"mask": {"opacity": "squares", "of": {"diffuse": {"reflectance": 0.6}}}},
    "one side": {"diffuse": {"reflectance": 0.6}, "sides": "front"},
    "brushed": {"conductor": {"metal": "Au", "alpha": [0.4, 0.1]}},
    "glass": {"dielectric": {"ior": 1.5}},
}


@pytest.mark.parametrize("uvs", [True, False])
@pytest.mark.parametrize("look", LOOKS)
def test_images_of_meshes_are_those_of_the_flattened_scene(look, uvs):
    """All paths are the same; here and there one goes another way, by a rounding error at an edge."""
    mesh = bumpy(150, **({"uvs": UVS} if uvs else {}), attributes={"vertex_color": COLOURS})
    lamp = {**TRIANGLE, "material": "lamp"}
    more = {"look": LOOKS[look], "lamp": {"emission": 3, "two_sided": True}}
    group = [{**mesh, "material": "look"}]
    scene = made(group, MATRICES.values(), [lamp], more, textures=TEXTURES)
    ours, theirs = seen(scene), seen(flattened(scene))
    differs = np.abs(ours - theirs).max(axis=2) > 1e-6
    assert differs.mean() < 0.03 and ours.std() > 0.01


@pytest.mark.parametrize("look", ["texture", "bump", "plain"])
def test_images_of_smooth_meshes_and_bumps_are_those_of_the_flattened_scene(look):
    looks = LOOKS | {"bump": {"bump": {"height": "waves", "scale": 0.1, "of": {"diffuse": {"reflectance": 0.6}}}}}
    mesh = {
        "mesh": {"vertices": np.random.default_rng(1).normal(size=(40, 3)), "faces": FACES, "uvs": UVS[:40], "smooth": True}
    }
    image = np.random.default_rng(4).random((8, 8))
    textures = TEXTURES | {"waves": {"image": image, "color_space": "raw"}}
    more = {"look": looks.get(look, {"diffuse": {"reflectance": 0.6}})}
    scene = made([{**mesh, "material": "look"}], [MATRICES[what] for what in SIMILAR], (), more, textures=textures)
    ours, theirs = seen(scene), seen(flattened(scene))
    differs = np.abs(ours - theirs).max(axis=2) > 1e-6
    assert differs.mean() < 0.03 and ours.std() > 0.01


FACES = np.random.default_rng(6).permutation(120).reshape(-1, 3) % 40


def test_a_shading_normal_of_a_stretched_instance_is_turned_by_the_inverse_transpose():
    vertices = [[-1, -1, 0], [1, -1, 0], [0, 2, 0], [0, -1, -3]]
    mesh = {"mesh": {"vertices": vertices, "faces": [[0, 1, 2], [0, 3, 1]], "smooth": True}}
    matrix = MATRICES["sheared"]
    scene = made([mesh], [matrix])
    context, (shape,) = renderer(scene)._context, scene.shapes
    target = matrix @ [0.1, 0.2, 0, 1]
    outward = np.linalg.inv(matrix[:, :3])[2]
    outward /= np.linalg.norm(outward)
    origin, direction = (target + outward)[:, None], -outward[:, None]
    at = context.surface(origin, direction, context.closest(origin, direction))
    a, b, c = shape.group.shapes[0].normals[[0, 1, 2]]
    v, w = (0.1 + 1 - 1.2 / 3) / 2, 1.2 / 3
    local = (1 - v - w) * a + v * b + w * c
    normal = local @ np.linalg.inv(matrix[:, :3])
    assert at.normal[:, 0] == pytest.approx(normal / np.linalg.norm(normal))
    assert at.geometric[:, 0] == pytest.approx(outward)


def test_the_depth_map_ends_at_the_corner_of_the_boxes_of_instances():
    scene = made(ROUND[:1], [np.column_stack([np.diag([2.0, 3, 4]), [1, 1, 1]])])
    assert Geometry(scene.shapes).upper_corner == pytest.approx([1 + 2 * 0.9, 1 + 3 * 0.8, 1 + 4 * 0.7])


def test_ten_thousand_instances_of_ten_thousand_triangles_add_less_than_ten_megabytes():
    mesh = bumpy(10_000)
    rng = np.random.default_rng(3)
    matrices = np.concatenate([np.tile(0.5 * np.eye(3), (10_000, 1, 1)), rng.random((10_000, 3, 1)) * 100], axis=2)
    few, many = made([mesh], matrices[:1]), made([mesh], matrices)
    sizes = []
    for scene in (few, many):
        tracemalloc.start()
        held = renderer(scene, "bvh")
        sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert sizes[1] - sizes[0] < 10e6 and sizes[1] > held.counters()["accelerator_bytes"] > 1e6
    begin = time.process_time()
    hits = held.trace(rng.random((200, 3)) * 100, rng.normal(size=(200, 3)))
    assert time.process_time() - begin < 3.0 and len(np.unique(hits.shape)) > 50 and hits.primitive.max() > 1000


def test_embreex_finds_what_numpy_finds():
    batch = engine("embreex_batch")
    scene = made([bumpy(), TRIANGLE, *ROUND], MATRICES.values(), before=[bumpy(40, 7)])
    if reason := batch.why_not(scene, Settings()):
        pytest.skip(reason)
    found, truth = batch.prepare(scene, Settings()).trace(*rays()), renderer(scene).trace(*rays())
    same = (found.shape == truth.shape) & (found.primitive == truth.primitive)
    assert same.mean() > 0.998 and found.t[same & (truth.shape >= 0)] == pytest.approx(
        truth.t[same & (truth.shape >= 0)], rel=1e-9
    )
