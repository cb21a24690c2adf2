"""Instances in the compiled engines: what the engine numpy finds, which is held against the flattened scene."""

import gc
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from engines import Settings, engine, scene_from
from engines.embree.library import Device
from engines.errors import Unsupported
from engines.kernels.rows import InstanceRow
from engines.numba_cpu.accel.choice import Counts, counts_of
from engines.scene import flattened
from harness.plan.planner import primitive_count

_SPEC = spec_from_file_location("instances_of_numpy", Path(__file__).parents[1] / "numpy_reference/test_instances.py")
assert _SPEC is not None and _SPEC.loader is not None
of_numpy = module_from_spec(_SPEC)
_SPEC.loader.exec_module(of_numpy)
MATRICES, ROUND, TRIANGLE, bumpy, made, rays = (
    getattr(of_numpy, name) for name in ("MATRICES", "ROUND", "TRIANGLE", "bumpy", "made", "rays")
)
PLANE = {"plane": {"point": [0, -3, 0], "normal": [0, 1, 0]}}
EXACT = [("none", "float64"), ("bvh", "float64")]
WATERTIGHT = {"name": "embree", "watertight": True}


def renderer(scene, accelerator, precision="float64", **more):
    """Of Embree's for its accelerators, else of numba's."""
    name = accelerator if isinstance(accelerator, str) else accelerator["name"]
    settings = Settings(accelerator=accelerator, precision=precision, threads=1, **more)
    return engine("embree" if name == "embree" else "numba").prepare(scene, settings)


@pytest.mark.parametrize(
    ("accelerator", "precision"),
    [*EXACT, ("none", "float32"), ("bvh", "float32"), ("embree", "float64"), ("embree", "float32"), (WATERTIGHT, "float32")],
)
def test_rays_find_in_instances_what_numpy_finds(accelerator, precision):
    before = [bumpy(40, 7), PLANE, ROUND[0], ROUND[2]]
    scene = made([bumpy(), TRIANGLE, *ROUND], MATRICES.values(), before=before)
    truth = of_numpy.renderer(scene)
    wanted, (origins, directions) = truth.trace(*rays()), rays()
    ours = renderer(scene, accelerator, precision)
    found = ours.trace(origins, directions)
    same = (found.shape == wanted.shape) & (found.primitive == wanted.primitive)
    hit = same & (wanted.shape >= 0)
    exact = precision == "float64"
    assert same.all() if exact else same.mean() > 0.999
    assert (wanted.shape >= 4).mean() > 0.2
    assert found.t[hit] == pytest.approx(wanted.t[hit], rel=1e-12 if exact else 1e-4)
    for name in ("normal", "u", "v"):
        assert getattr(found, name)[hit] == pytest.approx(getattr(wanted, name)[hit], abs=1e-11 if exact else 1e-4), name
    dark = ours.occluded(origins, directions, 6.0) == truth.occluded(origins, directions, 6.0)
    assert dark.all() if exact else dark.mean() > 0.999


@pytest.mark.parametrize(("accelerator", "precision"), [*EXACT, (WATERTIGHT, "float32")])
def test_of_equal_distances_the_lowest_shape_and_primitive_win(accelerator, precision):
    same = np.eye(3, 4)
    scene = made([TRIANGLE, TRIANGLE], [same] * 3, before=[TRIANGLE])
    for order, met in (((0, 1, 2, 3), 0), ((1, 0, 2, 3), 0), ((1, 2, 3, 0), 0)):
        shown = of_numpy.replace(scene, shapes=tuple(scene.shapes[k] for k in order))
        hits = renderer(shown, accelerator, precision).trace([0, 0.3, 5], [0, 0, -1])
        assert (hits.shape[0], hits.primitive[0], hits.t[0]) == (met, 0, 5.0)


@pytest.mark.parametrize("first", [0, 1])
def test_embree_gives_ties_of_round_shapes_to_the_lowest_shape(first):
    disk = {"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}}
    scene = made([disk], [np.eye(3, 4)] * 2, before=[disk])
    ours = renderer(scene, "embree")
    for order in ((0, 1, 2), (1, 0, 2), (1, 2, 0)):
        ours.update(shapes=[scene.shapes[k] for k in order])
        assert ours.trace([0, 0.3, 5 + first], [0, 0, -1]).shape[0] == 0


@pytest.mark.parametrize("kind", ["sphere", "disk", "cylinder", "triangle"])
def test_embree_misses_no_silhouette_of_a_small_group_far_from_the_origin(kind):
    """Its rays enter a group in float32: there they are off by much more than a millionth of the group. They go down along the
    boxes of shapes one below the other, of which single ones would have none."""
    place, levels, rng = np.array([700.0, 300.0, -500.0]), range(0, -32, -4), np.random.default_rng(4)
    group = {
        "sphere": [{"sphere": {"center": [0, 0, z], "radius": 1}} for z in levels],
        "disk": [{"disk": {"center": [0, 0, z], "normal": [0, 0, 1], "radius": 1}} for z in levels],
        "cylinder": [{"cylinder": {"p0": [-1, 0, z], "p1": [1, 0, z], "radius": 1}} for z in levels],
        "triangle": [{"triangle": {"a": [-1, -1, z], "b": [1, -1, z], "c": [0, 1, z]}} for z in levels],
    }[kind]
    matrices = [np.column_stack([0.1 * np.eye(3), place - [0, 0, z]]) for z in (0, 10, 20, 30)]
    scene = made(group, matrices, before=[TRIANGLE, _FAR])
    along = rng.uniform(-0.9, 0.9, 4000) if kind in ("cylinder", "triangle") else np.zeros(4000)
    inside = rng.uniform(1e-6, 2e-5, along.size)
    targets = place + 0.1 * np.stack([along, inside - 1, 0 * along], axis=1)
    origins, down = targets + np.array([0, 0, 800.0]), np.tile([0.0, 0, -1], (len(targets), 1))
    wanted = of_numpy.renderer(scene).trace(origins, down)
    found = renderer(scene, WATERTIGHT, "float64").trace(origins, down)
    assert (wanted.shape == 2).mean() > 0.9 and np.array_equal(found.shape, wanted.shape)


_FAR = {"sphere": {"center": [-900, -900, -900], "radius": 1}}


@pytest.mark.parametrize("accelerator", ["grid", "area_hierarchy"])
def test_accelerators_without_instances_decline_them_in_one_line(accelerator):
    scene = made([TRIANGLE], [np.eye(3, 4)])
    settings = Settings(accelerator=accelerator)
    reason = engine("numba").why_not(scene, settings)
    assert reason == f"the accelerator {accelerator} finds no instances"
    with pytest.raises(Unsupported, match="finds no instances"):
        engine("numba").prepare(scene, settings)


def test_a_row_of_an_instance_has_at_most_256_bytes():
    assert InstanceRow.size * np.dtype(InstanceRow.dtype).itemsize <= 256


@pytest.mark.parametrize("name", ["numba", "embree"])
def test_small_groups_wake_no_threads(name, monkeypatch):
    """Of 2,000 groups of a triangle that takes half the time."""
    groups = {f"g{k}": [{**TRIANGLE, "material": "grey"}] for k in range(300)}
    shapes = [{"instance": {"group": group, "matrix": np.eye(3, 4)}} for group in groups]
    materials = {"grey": {"kd": 0.5}}
    scene = scene_from(
        {"raybench_scene": 1, "camera": of_numpy.CAMERA, "materials": materials, "groups": groups, "shapes": shapes}
    )
    woken, submit = [], ThreadPoolExecutor.submit
    monkeypatch.setattr(ThreadPoolExecutor, "submit", lambda *given: woken.append(1) or submit(*given))
    accelerator = "bvh" if name == "numba" else "embree"
    hits = engine(name).prepare(scene, Settings(accelerator=accelerator, threads=2)).trace([0, 0.3, 5], [0, 0, -1])
    assert hits.t[0] == 5.0 and len(woken) < 150


def test_counts_of_shapes_look_at_each_group_once():
    scene = made([TRIANGLE] * 1000 + [*ROUND], [np.eye(3, 4)] * 2000, before=[TRIANGLE, PLANE])
    started = time.process_time()
    assert counts_of(scene) == Counts(2_000_001, 3 * 2000, 2 * 2000)
    assert primitive_count(scene) == 2_000_001 + 1 + 5 * 2000
    assert time.process_time() - started < 0.1


def test_embrees_memory_is_freed_with_the_renderer_without_the_cyclic_collector():
    others = {id(found) for found in gc.get_objects() if type(found) is Device}  # isinstance asks weak proxies for their object
    held = renderer(made([TRIANGLE], [np.eye(3, 4)]), "embree")
    devices = [weakref.ref(found) for found in gc.get_objects() if type(found) is Device and id(found) not in others]
    assert devices
    gc.disable()
    try:
        del held
        assert not any(device() for device in devices)
    finally:
        gc.enable()


@pytest.mark.parametrize("accelerator", ["bvh", "embree"])
def test_ten_thousand_instances_of_ten_thousand_triangles_add_less_than_ten_megabytes(accelerator):
    rng = np.random.default_rng(3)
    matrices = np.concatenate([np.tile(0.5 * np.eye(3), (10_000, 1, 1)), rng.random((10_000, 3, 1)) * 100], axis=2)
    sizes = []
    for shown in (matrices[:1], matrices):
        counters = renderer(made([bumpy(10_000)], shown), accelerator).counters()
        sizes.append(counters["accelerator_bytes"] + counters["scene_bytes"])
    assert 0 < sizes[1] - sizes[0] < 10e6


def film(made, **settings):
    return made(shader={"name": "path_tracer", "max_depth": 4}, sampler="random", **settings).render(2).mean()


def assert_alike(ours, theirs):
    """All paths are the same; here and there one goes another way, by a rounding error at an edge."""
    differs = np.abs(ours - theirs).max(axis=2) > 1e-6
    assert differs.mean() < 0.03 and ours.std() > 0.01


def shown(look, matrices):
    mesh, lamp = {**bumpy(150, uvs=of_numpy.UVS), "material": "look"}, {**TRIANGLE, "material": "lamp"}
    more = {"look": of_numpy.LOOKS[look], "lamp": {"emission": 3, "two_sided": True}}
    return made([mesh, *ROUND], matrices, [lamp], more, textures=of_numpy.TEXTURES)


@pytest.mark.parametrize("look", ["texture", "brushed", "glass"])
def test_images_are_those_of_numpy(look):
    scene = shown(look, MATRICES.values())
    assert_alike(film(partial(renderer, scene, "bvh")), film(partial(of_numpy.renderer, scene)))


@pytest.mark.parametrize("look", ["texture", "brushed"])
def test_images_of_embree_are_those_of_the_flattened_scene(look):
    scene = shown(look, [MATRICES[name] for name in of_numpy.SIMILAR])
    assert_alike(*(film(partial(renderer, each, "embree")) for each in (scene, flattened(scene))))
