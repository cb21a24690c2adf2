"""What `trace` and `occluded` make of rays, good and bad."""

import warnings

import numpy as np
import pytest

from engines.interface import Settings
from engines.numpy_reference import Engine
from engines.scene import Plane, Sphere
from tests.numpy_reference.small_scenes import box_mesh, rays_around, scene, tracer

SHAPES = (Plane((0.0, -1.5, 0.0), (0.0, 1.0, 0.0), 0), Sphere((0.0, 0.0, 0.0), 1.0, 0), box_mesh((2, -1, -1), (3, 1, 1)))
BAD = [
    ((np.nan, 0, 5), (0, 0, -1), np.inf),
    ((0, np.inf, 5), (0, 0, -1), np.inf),
    ((0, 0, 5), (0, 0, 0), np.inf),
    ((0, 0, 5), (0, np.nan, -1), np.inf),
    ((0, 0, 5), (0, 0, -np.inf), np.inf),
    ((0, 0, 5), (0, 0, -1), np.nan),
    ((0, 0, 5), (0, 0, -1), -1.0),
    ((0, 0, 5), (0, 0, -1), 0.0),
    ((0, 0, 5), (0, 0, -1), -np.inf),
]


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_rays_that_make_no_sense_miss_and_disturb_no_other(accelerator):
    origins, directions, reach = (np.array(column, float) for column in zip(*BAD, strict=True))
    origins, directions = np.append(origins, [[0, 0, 5.0]], axis=0), np.append(directions, [[0, 0, -1.0]], axis=0)
    reach = np.append(reach, np.inf)
    renderer = tracer(*SHAPES, accelerator=accelerator)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hits = renderer.trace(origins, directions, reach)
        dark = renderer.occluded(origins, directions, reach)
    assert np.isinf(hits.t[:-1]).all() and (hits.shape[:-1] == -1).all() and (hits.primitive[:-1] == -1).all()
    assert not hits.normal[:-1].any()
    assert hits.t[-1] == 4.0 and hits.shape[-1] == 1 and dark.tolist() == [False] * len(BAD) + [True]


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
def test_the_interval_is_open_at_t_max(accelerator):
    renderer = tracer(*SHAPES, accelerator=accelerator)
    ray = [(0.0, 0.0, 5.0)], [(0.0, 0.0, -2.0)]
    assert renderer.trace(*ray).t[0] == 2.0
    assert np.isinf(renderer.trace(*ray, t_max=2.0).t[0]) and not renderer.occluded(*ray, t_max=2.0)[0]
    assert renderer.trace(*ray, t_max=2.0000001).t[0] == 2.0 and renderer.occluded(*ray, t_max=2.0000001)[0]


@pytest.mark.parametrize("accelerator", ["none", "bvh"])
@pytest.mark.parametrize("length", [1e-30, 1e30])
def test_directions_of_any_length_find_the_same(accelerator, length):
    origins, directions = rays_around(500)
    renderer = tracer(*SHAPES, accelerator=accelerator)
    once, scaled = renderer.trace(origins, directions), renderer.trace(origins, directions * length)
    assert np.array_equal(once.shape, scaled.shape) and np.array_equal(once.primitive, scaled.primitive)
    assert np.allclose(once.t, scaled.t * length, rtol=1e-10, atol=0)
    assert np.allclose(once.u, scaled.u, atol=1e-10) and np.allclose(once.v, scaled.v, atol=1e-10)


def test_normals_are_unit_and_face_the_ray():
    origins, directions = rays_around(2000)
    hits = tracer(*SHAPES).trace(origins, directions)
    found = hits.shape >= 0
    assert set(hits.shape[found]) == {0, 1, 2}
    assert np.allclose(np.linalg.norm(hits.normal[found], axis=1), 1.0, rtol=4e-16, atol=0)
    assert ((hits.normal * directions).sum(axis=1)[found] < 0).all()


def test_weights_place_the_hit_in_its_triangle():
    origins, directions = rays_around(2000)
    box = SHAPES[2]
    hits = tracer(box).trace(origins, directions)
    found = hits.shape >= 0
    a, b, c = box.vertices[box.faces[hits.primitive[found]]].transpose(1, 0, 2)
    u, v = hits.u[found, None], hits.v[found, None]
    place = origins[found] + hits.t[found, None] * directions[found]
    assert np.allclose((1 - u - v) * a + u * b + v * c, place, rtol=0, atol=1e-14)


def test_no_rays_and_no_shapes_are_legal():
    assert tracer(*SHAPES).trace(np.zeros((0, 3)), np.zeros((0, 3))).t.shape == (0,)
    assert tracer(*SHAPES).occluded(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)
    for accelerator in ("auto", "none", "bvh"):
        empty = Engine().prepare(scene(), Settings(accelerator=accelerator))
        assert np.isinf(empty.trace([(0, 0, 0)], [(0, 0, 1)]).t).all()
        assert not empty.occluded([(0, 0, 0)], [(0, 0, 1)]).any()
        assert not empty.render(1).mean().any()
