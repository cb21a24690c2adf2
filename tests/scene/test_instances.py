"""Groups and instances in scene files: what is read, what is refused, and what it costs."""

import time
import tracemalloc

import numpy as np
import pytest

from engines import Settings, engine, load_scene, save_scene, scene_from
from engines.errors import ConfigError, SceneError
from engines.scene import Cylinder, Disk, Instance, Mesh, Sphere, flattened, groups_of
from engines.scene.light_bounds import light_bounds

CAMERA = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0], "resolution": [4, 4]}
BALL = {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}
MATRIX = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
FLOOR = {"point": [0, 0, 0], "normal": [0, 1, 0]}
TRIANGLE = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}


def keys(groups=None, shapes=None, **more):
    materials = {"grey": {"kd": 0.5}, "lamp": {"emission": 1}}
    shown = [instance()] if shapes is None else shapes
    groups = {"balls": [BALL]} if groups is None else groups
    return {"raybench_scene": 1, "camera": CAMERA, "materials": materials, "groups": groups, "shapes": shown, **more}


def instance(matrix=MATRIX, group="balls"):
    return {"instance": {"group": group, "matrix": matrix}}


def test_an_instance_has_the_group_and_the_matrix_that_the_file_names():
    scene = scene_from(keys(shapes=[BALL, instance(), instance([[2, 0, 0, 7], [0, 2, 0, 8], [0, 0, 2, 9]])]))
    _, first, second = scene.shapes
    assert isinstance(first, Instance) and isinstance(second, Instance) and first.group is second.group
    assert isinstance(first.group.shapes[0], Sphere) and first.group.name == "balls"
    assert second.matrix.tolist() == [[2, 0, 0, 7], [0, 2, 0, 8], [0, 0, 2, 9]] and not second.matrix.flags.writeable
    assert groups_of(scene.shapes) == [first.group]


def test_the_box_of_an_instance_is_that_of_the_eight_corners_of_its_groups_box():
    group = [BALL, {"triangle": {"a": [0, 0, 0], "b": [3, 0, 0], "c": [0, 5, 0]}, "material": "grey"}]
    matrix = np.random.default_rng(1).normal(size=(3, 4))
    (shape,) = scene_from(keys({"balls": group}, [instance(matrix)])).shapes
    corners = np.array([[x, y, z, 1] for x in (-1, 3) for y in (-1, 5) for z in (-1, 1)]) @ matrix.T
    assert shape.bounds() == pytest.approx(np.stack([corners.min(axis=0), corners.max(axis=0)]))


def test_what_shines_from_everywhere_shines_on_the_boxes_of_instances():
    sun = [{"directional": {"direction": [0, -1, 0], "irradiance": 1}}]
    wide = scene_from(keys(shapes=[instance([[9, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])], lights=sun))
    radius = np.linalg.norm([18, 2, 2]) / 2
    assert light_bounds(wide)[0].power == pytest.approx(np.pi * radius**2)


REFUSED = {
    "unknown group": (keys(shapes=[instance(group="ball")]), "shapes[0].instance.group = 'ball': unknown group"),
    "no groups": (keys({}), "shapes[0].instance.group = 'balls': unknown group"),
    "flat": (keys(shapes=[instance([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]])]), "not singular"),
    "zero": (keys(shapes=[instance(np.zeros((3, 4)))]), "not singular"),
    "not finite": (keys(shapes=[instance([[1, 0, 0, float("inf")], *MATRIX[1:]])]), "must be finite"),
    "too far": (keys(shapes=[instance([[1e300, 0, 0, 0], [0, 1e300, 0, 0], [0, 0, 1e300, 0]])]), "within 1e+30 metres"),
    "two rows": (keys(shapes=[instance(MATRIX[:2])]), "must be a matrix"),
    "words": (keys(shapes=[instance("identity")]), "must be a matrix"),
    "a material of its own": (keys(shapes=[{**instance(), "material": "grey"}]), "an instance has no material"),
    "an instance in a group": (keys({"balls": [BALL], "more": [instance()]}), "groups.more[0].instance: an instance in"),
    "an instance of its own group": (keys({"balls": [instance()]}), "groups.balls[0].instance: an instance in the group"),
    "a plane": (
        keys({"balls": [{"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "grey"}]}),
        "a plane in a group",
    ),
    "a lamp": (keys({"balls": [{**BALL, "material": "lamp"}]}), "groups.balls[0]: material 'lamp' emits"),
    "a lamp among triangles": (keys({"balls": [{"mesh": TRIANGLE, "material": "lamp"}]}), "material 'lamp' emits"),
    "an empty group": (keys({"balls": []}), "groups.balls: group 'balls': must hold shapes"),
    "a group of nothing": (keys({"balls": None}), "must hold shapes"),
    "groups within groups": (keys({"balls": {"inner": [BALL]}}), "groups.balls: must be a list of shapes"),
    "a list of groups": (keys([BALL]), "groups: must be a mapping"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_wrong_with_groups_and_instances_is_said_in_one_line(what):
    given, said = REFUSED[what]
    with pytest.raises(SceneError) as refused:
        scene_from(given)
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_a_billion_instances_by_aliases_are_refused_at_once(tmp_path):
    text = "raybench_scene: 1\nshapes:\n  - &a0 {instance: {group: g, matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}}\n"
    text += "".join(f"  - &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(9))
    (tmp_path / "scene.yaml").write_text(text, encoding="ascii")
    started = time.process_time()
    with pytest.raises(SceneError, match="more than 400000 values") as refused:
        load_scene(tmp_path / "scene.yaml")
    assert "\n" not in str(refused.value) and time.process_time() - started < 1.0


def test_a_thousand_groups_within_each_other_are_refused_at_once():
    nested = [BALL]
    for _ in range(1000):
        nested = {"inner": nested}
    started = time.process_time()
    with pytest.raises(SceneError, match="nested deeper than 64 levels"):
        scene_from(keys({"balls": nested}))
    assert time.process_time() - started < 1.0


def test_the_number_of_instances_is_bounded(monkeypatch):
    monkeypatch.setattr("engines.scene.shapes.MAX_INSTANCES", 2)
    with pytest.raises(SceneError, match=r"shapes\[2\].instance: more than 2 instances"):
        scene_from(keys(shapes=[instance()] * 3))


def test_a_group_of_python_that_emits_is_declined():
    scene = scene_from(keys())
    (shape,) = scene.shapes
    lit = Instance(type(shape.group)("lit", (Sphere((0.0, 0.0, 0.0), 1.0, 1),)), shape.matrix)
    reason = engine("numpy").why_not(type(scene)("s", scene.camera, scene.materials, (lit,), (), ""), Settings())
    assert reason == "group 'lit': material 'lamp' emits: groups hold no lights"


def test_a_saved_scene_has_its_groups_and_the_same_hash(tmp_path):
    groups = {"balls": [BALL, {"mesh": TRIANGLE, "material": "grey"}], "Balls ": [BALL]}
    given = scene_from(keys(groups, [BALL, instance(), instance(group="Balls "), instance(np.eye(3, 4) / 3)]))
    loaded = load_scene(save_scene(given, tmp_path))
    assert loaded.content_hash == given.content_hash
    assert [type(shape) for shape in loaded.shapes] == [type(shape) for shape in given.shapes]
    assert len(groups_of(loaded.shapes)) == 2 and len(list(tmp_path.glob("meshes/*"))) == 1


@pytest.mark.parametrize("count", [40, 60])
def test_what_is_saved_is_read_again_and_more_instances_than_a_file_holds_are_refused(count, tmp_path, monkeypatch):
    """Each is 22 values and keys."""
    monkeypatch.setattr("engines.schema.strict_yaml.MAX_NODES", 1000)
    scene = scene_from(keys(shapes=[instance()] * count))
    if count == 40:
        assert load_scene(save_scene(scene, tmp_path)).content_hash == scene.content_hash
        return
    with pytest.raises(ConfigError, match=r"scene.yaml: 1,3\d\d values and keys, of at most 1,000 that are read of a file"):
        save_scene(scene, tmp_path)
    assert not list(tmp_path.glob("*.yaml"))


def test_the_hash_knows_matrices_and_what_groups_hold_but_no_names():
    plain = scene_from(keys()).content_hash
    renamed = keys({"other": [BALL]}, [instance(group="other")])
    assert scene_from(renamed).content_hash == plain
    assert scene_from(keys({"balls": [BALL], "unused": [BALL]})).content_hash == plain
    assert scene_from(keys(shapes=[instance([[1, 0, 0, 0.5], *MATRIX[1:]])])).content_hash != plain
    assert scene_from(keys({"balls": [BALL, BALL]})).content_hash != plain
    black = keys({"balls": [{**BALL, "material": "black"}]}) | {"materials": {"grey": {"kd": 0.5}, "black": {}}}
    assert scene_from(black).content_hash != plain


def test_ten_thousand_instances_of_ten_thousand_triangles_take_a_second_and_ten_megabytes():
    rng = np.random.default_rng(3)
    mesh = {"vertices": rng.normal(size=(5000, 3)), "faces": rng.integers(0, 5000, (10_000, 3))}
    given = keys({"balls": [{"mesh": mesh, "material": "grey"}]}, [instance(m) for m in rng.normal(size=(10_000, 3, 4))])
    started = time.process_time()
    scene = scene_from(given)
    assert time.process_time() - started < 2.0  # 0.7 s alone
    (group,) = groups_of(scene.shapes)
    tracemalloc.start()
    some = [Instance(group, np.eye(3, 4)) for _ in range(1000)]
    each = tracemalloc.get_traced_memory()[0] / len(some)
    tracemalloc.stop()
    assert each * len(scene.shapes) < 10e6


@pytest.mark.parametrize("mirror", [1, -1])
def test_a_flattened_scene_has_the_shapes_where_their_instances_show_them(mirror):
    group = [
        {"mesh": TRIANGLE, "material": "grey"},
        {"disk": {"center": [0, 0, 1], "normal": [0, 0, 1], "radius": 1}, "material": "grey"},
        {"cylinder": {"p0": [0, 0, 0], "p1": [0, 0, 1], "radius": 0.5}, "material": "grey"},
        BALL,
    ]
    turned = np.array([[0, -2.0, 0, 1], [2, 0, 0, 2], [0, 0, 2.0 * mirror, 3]])
    scene = scene_from(keys({"balls": group}, [BALL, instance(turned)]))
    first, mesh, disk, cylinder, ball = flattened(scene).shapes
    assert first is scene.shapes[0] and flattened(flattened(scene)).shapes[2] == disk
    assert isinstance(mesh, Mesh) and mesh.vertices.tolist() == [[1, 2, 3], [1, 4, 3], [-1, 2, 3]]
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] * mirror > 0  # M^-T n
    assert disk == Disk((1.0, 2.0, 3.0 + 2 * mirror), (0.0, 0.0, float(mirror)), 2.0, 0)
    assert cylinder == Cylinder((1.0, 2.0, 3.0), (1.0, 2.0, 3.0 + 2 * mirror), 1.0, 0)
    assert ball == Sphere((1.0, 2.0, 3.0), 2.0, 0)


def test_a_round_shape_that_is_stretched_is_flattened_to_triangles_near_it():
    group = [BALL, {"disk": {"center": [0, 0, 1], "normal": [0, 0, 1], "radius": 1}, "material": "grey"}]
    matrix = np.array([[2.0, 0.5, 0, 1], [0, 1, 0, 0], [0, 0.2, -0.5, 0]])
    ball, disk = flattened(scene_from(keys({"balls": group}, [instance(matrix)]))).shapes
    assert isinstance(ball, Mesh) and isinstance(disk, Mesh)
    local = np.linalg.solve(matrix[:, :3], (ball.vertices - matrix[:, 3]).T)
    assert np.linalg.norm(local, axis=0) == pytest.approx(np.ones(len(ball.vertices)))
    assert ball.normals == pytest.approx(_unit(local.T @ np.linalg.inv(matrix[:, :3])))
    winding = np.cross(*(ball.vertices[ball.faces[:, i]] - ball.vertices[ball.faces[:, 0]] for i in (1, 2)))
    outside = (winding * ball.normals[ball.faces].sum(axis=1)).sum(axis=1)
    assert (outside[np.linalg.norm(winding, axis=1) > 1e-12] > 0).all()


def _unit(rows):
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def test_the_copies_of_a_flattened_scene_are_bounded(monkeypatch):
    monkeypatch.setattr("engines.scene.flattening.MAX_COPIED", 2)
    assert len(flattened(scene_from(keys(shapes=[instance()] * 2))).shapes) == 2
    with pytest.raises(SceneError, match="more than 2 triangles"):
        flattened(scene_from(keys(shapes=[instance()] * 3)))


@pytest.mark.parametrize("shape", ["triangle", "mesh", "sphere", "disk"])
def test_a_flattened_shape_has_the_media_of_the_shape_of_the_group(shape):
    kinds = {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "mesh": TRIANGLE, **BALL}
    kinds["disk"] = {"center": [0, 0, 1], "normal": [0, 0, 1], "radius": 1}
    group = [{shape: kinds[shape], "material": "grey", "interior": "fog", "exterior": "air"}]
    media = {name: {"sigma_t": 1, "albedo": 0.5} for name in ("air", "fog")}
    stretched = [[3, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
    for copy in flattened(scene_from(keys({"balls": group}, [instance(), instance(stretched)], media=media))).shapes:
        assert (copy.interior, copy.exterior) == (1, 0)


def test_copies_beyond_the_limit_are_not_made():
    many = {"spheres": {"centers": np.zeros((2000, 3)), "radii": [1] * 2000}, "material": "grey"}
    scene = scene_from(keys({"balls": [many]}, [instance([[3, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])]))
    tracemalloc.start()
    with pytest.raises(SceneError, match="more than 4,000,000 triangles"):
        flattened(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6  # some GB with copies
