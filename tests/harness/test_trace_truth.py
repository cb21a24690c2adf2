"""Exact answers, sets of rays, and what counts as wrong."""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.errors import Unsupported
from engines.scene import load_scene, scene_from
from harness.config import paths
from harness.config.settings import RAY_KINDS
from harness.statistics import proportion_interval
from harness.trace.judge import Judge, leaks
from harness.trace.rays import Rays, hard_rays, make_rays
from harness.trace.truth import Truth, triangle_distance
from harness.view.projection import Projection

CAMERA = {"type": "perspective", "eye": [0, 0, 6], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 50, "resolution": [8, 6]}
SHAPES = [
    {"sphere": {"center": [-1, 0.5, 0], "radius": 0.8}},
    {"spheres": {"centers": [[1, 1, 0], [1.3, 0, 0.5], [0, -1, 1]], "radii": [0.3, 0.5, 0.2]}},
    {"disk": {"center": [0.2, 0.1, 1], "normal": [0.2, 0.1, 1], "radius": 0.4}},
    {"cylinder": {"p0": [-1.5, -1.2, 0], "p1": [0.5, -0.8, 0.4], "radius": 0.25}},
    {"triangle": {"a": [-2, -2, -1], "b": [2, -2, -1.5], "c": [0, 2.5, -1]}},
    {"procedural": {"name": "tessellated_sphere", "subdivisions": 2, "center": [0.8, -1, -0.3], "radius": 0.6}},
    {"plane": {"point": [0, -2.2, 0], "normal": [0, 1, 0.1]}},
]


def made(shapes, lights=(), camera=CAMERA):
    return scene_from(
        {
            "raybench_scene": 1,
            "camera": camera,
            "materials": {"grey": {"kd": 0.5}, "lamp": {"emission": 1}},
            "shapes": [{"material": "grey", **shape} for shape in shapes],
            "lights": list(lights),
        }
    )


@pytest.fixture(scope="module")
def everything():
    return made(SHAPES)


@pytest.fixture(scope="module")
def box():
    return load_scene(paths.find("scenes", "cornell_box"))


def random_rays(n=1500):
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(n, 3)) * 2
    return Rays(origins, rng.normal(size=(n, 3)) - 0.3 * origins, np.where(rng.random(n) < 0.5, np.inf, 1.0))


def test_exact_hits_are_those_of_the_reference_engine_on_every_kind_of_shape(everything):
    rays, truth = random_rays(), Truth(everything)
    found = truth.closest(*rays)
    hits = engines.engine("numpy").prepare(everything, Settings(accelerator="none")).trace(*rays)
    met = found.item >= 0
    assert set(truth.items.shape[found.item[met]]) == set(range(len(SHAPES)))
    assert (met == np.isfinite(hits.t)).all()
    assert (truth.items.shape[found.item[met]] == hits.shape[met]).all()
    assert (truth.items.primitive[found.item[met]] == hits.primitive[met]).all()
    assert np.allclose(found.t[met], hits.t[met], rtol=1e-9)
    points = rays.origins[met] + found.t[met, None] * rays.directions[met]
    assert truth.distance(found.item[met], points).max() < 1e-9
    assert np.allclose(np.abs((truth.normals(found.item[met], points) * hits.normal[met]).sum(axis=1)), 1, atol=1e-9)
    assert (truth.item_of(hits.shape, hits.primitive) == found.item).all()
    faults = Judge(truth, rays).hits(hits.t, hits.shape, hits.primitive)
    assert (faults.total, faults.checked) == (0, len(met)) and faults.errors.max() < 1e-9


def test_a_ray_through_a_shared_edge_hits_and_both_neighbours_are_right():
    square = {"mesh": {"vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}}
    truth = Truth(made([square]))
    rays = Rays(np.array([[0.25, 0.25, 2.0]]), np.array([[0.0, 0.0, -1.0]]), np.array([np.inf]))
    judge = Judge(truth, rays)
    assert judge.exact.t[0] == 2.0
    for face in (0, 1):
        assert judge.hits(np.array([2.0]), np.array([0]), np.array([face])).total == 0
    assert judge.hits(np.array([np.inf]), np.array([-1]), np.array([-1])).missed == 1
    assert judge.hits(np.array([2.001]), np.array([0]), np.array([0])).wrong == 1
    assert judge.hits(np.array([2.0]), np.array([1]), np.array([0])).wrong == 1, "there is no such shape"


def test_at_an_outline_hit_and_miss_are_right_and_away_from_it_they_are_not():
    truth = Truth(made([SHAPES[4]]))
    edge, inside = np.array([0.0, -2.0, -1.25]), np.array([0.0, 0.01, 0.0])
    for shift, missed, false_hits in ((0.0, 0, 0), (1.0, 1, 0), (-1.0, 0, 1)):
        origin = edge + shift * inside + [0.0, 0.0, 3.0]
        judge = Judge(truth, Rays(origin[None], np.array([[0.0, 0.0, -1.0]]), np.array([np.inf])))
        t = judge.exact.t if shift > 0 else np.array([3.0])
        assert judge.hits(np.full(1, np.inf), np.full(1, -1), np.full(1, -1)).missed == missed
        assert judge.hits(t, np.zeros(1, np.int64), np.zeros(1, np.int64)).false_hits == false_hits
        assert judge.occlusions(np.array([False])).missed == missed
        assert judge.occlusions(np.array([True])).false_hits == false_hits


def test_the_distance_from_a_triangle_is_that_of_its_nearest_point():
    corners = np.tile([[0.0, 0, 0], [4, 0, 0], [0, 3, 0]], (5, 1, 1))
    points = np.array([[1.0, 1, 2], [2, -1, 0], [-3, -4, 0], [5, 0, 0], [4, 3, 0]])
    assert triangle_distance(corners, points) == pytest.approx([2, 1, 5, 1, 2.4])


def test_camera_rays_go_through_their_pixels_in_order(box):
    rays = make_rays("camera", box, Truth(box), 576, 3, 5)
    projection = Projection(box.camera, 24, 24)
    for number in range(0, 576, 37):
        x, y = projection.project(rays.origins[number] + 3 * rays.directions[number])
        assert (int(x), int(y)) == (number % 24, number // 24)


def test_shadow_rays_end_before_their_light_and_the_others_start_off_the_surface(box):
    truth = Truth(box)
    emitting = [i for i, s in enumerate(box.shapes) if box.materials[int(np.min(s.materials))].emits]
    light = np.flatnonzero(np.isin(truth.items.shape, emitting))
    rays = make_rays("shadow", box, truth, 200, 3, 1)
    ends = rays.origins + rays.directions
    near = np.min([truth.distance(np.full(200, item), ends) for item in light], axis=0)
    assert near.max() < 1e-5 and (rays.t_max < 1).all() and (rays.t_max > 0.99).all()
    rays = make_rays("incoherent", box, truth, 200, 3, 1)
    apart = np.min([truth.distance(np.full(200, i), rays.origins) for i in range(len(truth.items.shape))], axis=0)
    assert apart.min() > 1e-7 and apart.max() < 1e-4
    assert np.isinf(rays.t_max).all()


def test_a_seed_makes_the_same_rays_and_another_one_others(box):
    truth = Truth(box)
    for kind in RAY_KINDS:
        one, same, other = (make_rays(kind, box, truth, 100, 2, seed) for seed in (1, 1, 2))
        assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
        assert not np.array_equal(one.directions, other.directions)
        assert np.array_equal(one.directions, one.directions.astype(np.float32))


def test_hard_rays_meet_what_they_are_aimed_at_and_passing_is_a_leak(box):
    truth = Truth(box)
    rays = hard_rays(truth, 300, 1)
    exact = truth.closest(*rays)
    assert len(exact.t) == 300 and (exact.item >= 0).all()
    t = exact.t.copy()
    assert leaks(rays, t) == 0
    t[:3], t[3:5] = np.inf, 1.01
    assert leaks(rays, t) == 5
    assert len(hard_rays(Truth(made(SHAPES[:4])), 10, 1).t_max) == 0, "no triangles, no edges"


def test_scenes_without_such_rays_are_refused():
    dark = made([SHAPES[0]])
    with pytest.raises(Unsupported, match="no light that shadow rays could go to"):
        make_rays("shadow", dark, Truth(dark), 50, 1, 1)
    away = made([SHAPES[0]], camera={**CAMERA, "target": [0, 0, 12]})
    with pytest.raises(Unsupported, match="no ray of the camera hits anything"):
        make_rays("incoherent", away, Truth(away), 50, 1, 1)
    curved = made([SHAPES[0]], camera={**CAMERA, "type": "perspective_arctan"})
    with pytest.raises(Unsupported, match="this is PerspectiveArctan"):
        make_rays("camera", curved, Truth(curved), 50, 1, 1)


def test_intervals_of_proportions_are_those_of_clopper_and_pearson():
    assert proportion_interval(0, 100)[:3] == pytest.approx((0, 0, 1 - 0.05**0.01))
    assert proportion_interval(10, 100)[:3] == pytest.approx((0.1, 0.04900469, 0.17622260), abs=1e-7)
    assert proportion_interval(100, 100)[:3] == pytest.approx((1, 0.05**0.01, 1))
    assert np.isnan(proportion_interval(0, 0).value)
