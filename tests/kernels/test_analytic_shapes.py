"""Shapes that have a formula are found by every accelerator, those that a test registers too, as the plain list finds them."""

import ctypes
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.embree.accelerator import Accelerator as EmbreeAccelerator
from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.flatten import flatten
from engines.kernels.flatten.shapes import ANALYTIC, AnalyticShape
from engines.kernels.lane.shapes import disk
from engines.kernels.lane.vector import Vec3, dot
from engines.kernels.layout import LANES, RayBatch, aligned, batch_bytes
from engines.numba_cpu.engine import MADE
from engines.scene import Cylinder, Disk, Mesh, Plane, Sphere

CAMERA = {"type": "perspective", "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "resolution": [16, 16]}
EMPTY = {
    "raybench_scene": 1,
    "camera": CAMERA,
    "materials": {"white": {"kd": 0.7}},
    "lights": [{"point": {"position": [0, 3, 4], "intensity": 40}}],
    "shapes": [],
}
ACCELERATORS = sorted(set(MADE) - {"none"})


@dataclass(frozen=True)
class Ring:
    """A disk with a hole of half its radius, which no engine knows."""

    center: tuple[float, float, float]
    normal: tuple[float, float, float]
    radius: float
    material: int


@inline
def ring_distance(o, d, p):
    t = disk.distance(o, d, p)
    out = o + d * select(t < np.inf, t, 0.0) - Vec3(p[0], p[1], p[2])
    return select(dot(out, out) >= 0.25 * p[6] * p[6], t, np.inf)


@pytest.fixture
def rings(monkeypatch):
    """Registers `Ring`."""
    lane = SimpleNamespace(distance=ring_distance, intersection=disk.intersection)
    monkeypatch.setitem(ANALYTIC, Ring, AnalyticShape(99, ANALYTIC[Disk].parameters, disk.bounds, lane))


def triple(values):
    x, y, z = values
    return float(x), float(y), float(z)


def flat_shapes(kind, n, seed):
    """Shapes at random; every third lies across an axis."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(n, 3))
    normals[::3] = np.eye(3)[np.arange(len(normals[::3])) % 3]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return [kind(triple(random.uniform(-1, 1, 3)), triple(normal), float(random.uniform(0.05, 0.4)), 0) for normal in normals]


def tubes(n, seed):
    disks = flat_shapes(Disk, n, seed)
    return [Cylinder(disk.center, triple(np.add(disk.center, disk.normal)), disk.radius / 2, 0) for disk in disks]


def others(seed):
    random = np.random.default_rng(seed)
    corners = (random.uniform(-1, 1, (60, 1, 3)) + 0.1 * random.normal(size=(60, 3, 3))).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(180, dtype=np.int32).reshape(-1, 3), np.zeros(60, np.int32))
    spheres = [Sphere(triple(random.uniform(-1, 1, 3)), float(random.uniform(0.02, 0.2)), 0) for _ in range(30)]
    return [mesh, *spheres, Plane((0.0, -1.2, 0.0), (0.0, 1.0, 0.0), 0)]


def scene_of(shapes):
    return replace(engines.scene_from(EMPTY), shapes=tuple(shapes))


def answers(scene, accelerator, precision, engine="numba"):
    """All that a renderer finds: by rays from anywhere, by rays from the eye, and in an image with shadows."""
    random = np.random.default_rng(2)
    settings = Settings(16, 16, shader="whitted", accelerator=accelerator, precision=precision)
    renderer = engines.engine(engine).prepare(scene, settings)
    origins, directions = random.uniform(-1.5, 1.5, (1500, 3)), random.normal(size=(1500, 3))
    eye = np.tile([0.0, 0.0, 4.0], (1500, 1)), 0.2 * directions - [0, 0, 1]
    found = [
        getattr(hits, field)
        for hits in (renderer.trace(origins, directions), renderer.trace(*eye))
        for field in ("t", "shape", "primitive", "normal")
    ]
    return [*found, renderer.occluded(origins, directions, 0.8), renderer.render(1).sums]


def disks_rings_and_tubes(mixed):
    shapes = [*flat_shapes(Disk, 40, 5), *flat_shapes(Ring, 40, 6), *tubes(12, 7)]
    shapes = [*shapes, *shapes[38:42], *shapes[88:]]  # the same once more: of two hits at one place the first counts
    return [*shapes[:20], *others(7), *shapes[20:]] if mixed else shapes


CASES = [pytest.param(False, "float32", id="alone-float32"), pytest.param(True, "float64", id="among others-float64")]
"""Each pair of features and precision is compiled for every accelerator."""


@pytest.mark.parametrize("accelerator", ACCELERATORS)
@pytest.mark.parametrize(("mixed", "precision"), CASES)
def test_every_accelerator_finds_the_lists_hits_bit_for_bit(mixed, accelerator, precision, rings):
    shapes = disks_rings_and_tubes(mixed)
    scene = scene_of(shapes)
    plain, ours = answers(scene, "none", precision), answers(scene, accelerator, precision)
    met = np.unique(plain[1][np.isfinite(plain[0])])
    assert {type(shapes[k]) for k in met} == {type(shape) for shape in shapes}
    for a, b in zip(plain, ours, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize(("mixed", "precision"), CASES)
def test_embree_finds_the_lists_hits(mixed, precision, rings):
    scene = scene_of(disks_rings_and_tubes(mixed))
    plain, ours = answers(scene, "none", "float64"), answers(scene, "embree", precision, "embree")
    tolerance = 1e-12 if precision == "float64" else 1e-5
    for field, a, b in zip(("t", "shape", "primitive", "normal") * 2, plain, ours, strict=False):
        exact = field in ("shape", "primitive")
        assert np.array_equal(a, b) if exact else np.allclose(a, b, rtol=tolerance, atol=tolerance), field
    assert np.array_equal(plain[8], ours[8])


def test_a_disk_and_a_ring_are_where_they_are_said_to_be(rings):
    shapes = [Disk((-2.0, 0, 0), (0, 0, 1.0), 1.0, 0), Ring((2.0, 0, 0), (0, 0, -1.0), 1.0, 0), *tubes(1, 7)]
    radii = np.array([0.0, 0.49, 0.51, 0.99, 1.01])
    for accelerator in ("none", *ACCELERATORS):
        settings = Settings(4, 4, accelerator=accelerator, precision="float32")
        renderer = engines.engine("numba").prepare(scene_of(shapes), settings)
        for x, hit in ((-2.0, radii < 1), (2.0, (radii < 1) & (radii > 0.5))):
            origins = np.stack([x + radii, 0 * radii, 0 * radii + 3], axis=1)
            assert renderer.trace(origins, [[0, 0, -1]] * 5).t.tolist() == np.where(hit, 3.0, np.inf).tolist()
            assert not np.isfinite(renderer.trace(origins, [[0, 0, 1]] * 5).t).any()


FAR_AWAY = [
    Ring((50.0, 0, 0), (0, 0, 1.0), 1.0, 0),
    Cylinder((50.0, 0, 0), (50.0, 1.0, 0), 1.0, 0),
    Sphere((50.0, 0, 0), 1.0, 0),
    Plane((50.0, 0, 0), (1.0, 0, 0), 0),
    Mesh(np.eye(3) + 50.0, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)),
]
"""All kinds of shapes that stand among others: what is compiled for them is compiled once."""


def run_batch(accelerator, shapes, fields):
    """(closest ids, occluded) of sixteen rays, straight from the accelerator's stages."""
    shapes = [*shapes, *FAR_AWAY]
    if accelerator == "embree":
        made = EmbreeAccelerator({"quality": "medium", "robust": True, "watertight": False}, refine=True)
    else:
        made = MADE[accelerator]({"density": 4.0})
    flat = flatten(scene_of(shapes), np.float64, made.precision or np.float64)
    made.build(flat, 1)
    stages = made.stages(flat.features, np.float64)
    memory = aligned(batch_bytes(np.float64, made.scratch))
    numbers = memory[: RayBatch.bytes(np.float64)].view(np.float64).reshape(-1, LANES)
    words = numbers.view(np.int64)
    for name, values in fields.items():
        target = words if name == "origin_primitive" else numbers
        target[(first := RayBatch.field(name).first) : first + len(values)] = values
    for stage in stages:
        ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(stage.address)(memory.ctypes.data, flat.address)
    return words[RayBatch.field("primitive").first].copy(), words[RayBatch.field("shadow.occluded").first].copy()


@pytest.mark.parametrize("accelerator", ["none", *ACCELERATORS, "embree"])
def test_a_ray_does_not_meet_the_disk_that_it_leaves_and_ends_before_its_end(accelerator, rings):
    here = Disk((0, 0, 0), (0, 0, 1.0), 1.0, 0)
    left = np.array([-1, 0, 1, -1] * 4)
    t_max = np.array([np.inf, np.inf, np.inf, 1e-3] * 4)
    origin, down = np.outer([0.1, 0.2, 1e-3], np.ones(16)), np.outer([0, 0, -1.0], np.ones(16))
    ray = {"origin": origin, "direction": down, "t": [t_max], "origin_primitive": [left]}
    shadow = {"shadow.origin": origin, "shadow.direction": down, "shadow.t_max": [t_max]}
    closest, occluded = run_batch(accelerator, [here, here], {**ray, **shadow})
    assert closest.tolist() == [0, 1, 0, -1] * 4
    assert occluded.tolist() == [1, 1, 1, 0] * 4
    closest, occluded = run_batch(accelerator, [here], {**ray, **shadow})
    assert closest.tolist() == [0, -1, 0, -1] * 4
    assert occluded.tolist() == [1, 0, 1, 0] * 4


@pytest.mark.parametrize(
    ("engine", "precision"), [("numba", "float32"), ("embree", "float32"), ("embree", "float64"), ("embreex_batch", "float64")]
)
@pytest.mark.parametrize(
    "floor",
    [
        {"disk": {"center": [0, 0, 0], "normal": [0, 1, 0], "radius": 45_000}},
        {"sphere": {"center": [0, -45_000, 0], "radius": 45_000}},
        {"cylinder": {"p0": [-4000, -45_000, 0], "p1": [4000, -45_000, 0], "radius": 45_000}},
    ],
    ids=["disk", "sphere", "cylinder"],
)
def test_a_floor_of_any_radius_leaks_no_light(floor, engine, precision):
    """Rays leave it as far as where they meet it asks for, so that those from beside a ball's foot meet the ball."""

    def film(floor, engine, precision):
        ball = {"sphere": {"center": [0, 0.5, 0], "radius": 0.5}}
        below = {"triangle": {"a": [0, -1, 0], "b": [1, -1, 0], "c": [0, -1, 1]}}  # embreex_batch wants one
        shapes = [{**shape, "material": "white"} for shape in (floor, ball, below)]
        camera = {**CAMERA, "eye": [0, 1, 4], "target": [0, 0.3, 0], "fov": 18}
        sky = {"environment": {"radiance": [1, 1, 1]}}
        scene = engines.scene_from({**EMPTY, "camera": camera, "shapes": shapes, "lights": [sky]})
        film = engines.engine(engine).prepare(scene, Settings(precision=precision)).render(spp=16)
        return film.mean().reshape(4, 4, 4, 4, 3).mean((1, 3))  # tiles: a path may turn otherwise

    flat = film({"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}}, "numba", "float64")
    assert film(floor, engine, precision) == pytest.approx(flat, rel=0.01)
