"""Light, bsdf and mis must agree wherever they are all able to answer, and every sample with its pdf.

Comparisons are by z of the difference of two independent means, |z| < 4.5: a false alarm has probability 7e-6 a test.
"""

import numpy as np
import pytest

from engines.scene import Disk, EnvironmentLight, Plane, PointLight, Sphere, SphereSet, Triangle
from tests.numpy_reference.bsdf_points import GOLD, conductor
from tests.numpy_reference.small_scenes import (
    box_mesh,
    material,
    path_tracer,
    point_view,
    renderer,
    scene,
    sphere_mesh,
    unit_rows,
)

RNG = np.random.default_rng(0)
IMAGE = RNG.random((6, 12, 3)) ** 4
FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
MATERIALS = [
    material(kd=0.6),
    material(emission=3.0),
    material(emission=1.0, two_sided=True),
    material(kd=0.3, ks=0.4),
    conductor((0.3, 0.6), GOLD),
]
TRIANGLE = Triangle((-1.0, 1.5, -1.0), (1.0, 1.5, -1.0), (0.0, 1.2, 1.0), 1)
LIGHTS = {
    "triangle": ([TRIANGLE], []),
    "mesh": ([box_mesh((-1.0, 1.0, -1.0), (0.0, 1.7, 1.0))], []),
    "disk": ([Disk((-0.3, 1.2, 0.3), (0.6, -0.8, 0.0), 0.8, 1)], []),
    "sphere": ([Sphere((0.5, 1.3, 0.4), 0.6, 1)], []),
    "sphere close by": ([Sphere((0.0, 1.00001, 0.0), 1.0, 2)], []),
    "spheres": ([SphereSet(np.array([[0.5, 1.3, 0.4], [-1, 0.8, 0.3], [0, 2, -2]]), np.array([0.3, 0.2, 0.9]), 1)], []),
    "constant sky": ([], [EnvironmentLight((0.5, 0.5, 0.5))]),
    "image sky": ([], [EnvironmentLight((1.0, 1.0, 1.0), IMAGE)]),
    "all": (
        [
            TRIANGLE,
            Sphere((0.5, 2.3, 0.4), 0.2, 2),
            sphere_mesh(6, (-1.0, 1.0, 0.6), 0.3),
            Plane((0.0, 9.0, 0.0), (0.0, -1.0, 0.0), 1),
        ],
        [
            PointLight((0.0, 1.0, 2.0), (1.0, 1.0, 1.0)),
            EnvironmentLight((0.2, 0.2, 0.2)),
            EnvironmentLight((1.0, 1.0, 1.0), IMAGE),
        ],
    ),
}


def lit_scene(name, floor=0, x=1.1):
    shapes, lights = LIGHTS[name]
    if name in ("mesh", "all"):
        for shape in shapes:
            if hasattr(shape, "materials"):
                shape.materials[:] = 1
    ground = Plane(FLOOR.point, FLOOR.normal, floor)
    return scene([ground, *shapes], MATERIALS, lights, point_view((x + 0.1, 0.8, 3.0), (x, 0.0, 0.0), 48))


@pytest.mark.parametrize("floor", [0, 3, 4], ids=["diffuse", "half a mirror", "rough metal"])
@pytest.mark.parametrize("name", LIGHTS)
def test_all_strategies_have_the_same_mean(name, floor):
    seen = {}
    for seed, direct in enumerate(("light", "bsdf", "mis")):
        film = renderer(lit_scene(name, floor), shader=path_tracer(3, direct), seed=seed).render(16)
        assert film.bad_samples == 0
        values = film.mean().mean(axis=2)
        seen[direct] = values.mean(), values.var(ddof=1) / values.size
        assert seen[direct][0] > 0
    for a, b in (("light", "bsdf"), ("light", "mis"), ("bsdf", "mis")):
        (mean_a, variance_a), (mean_b, variance_b) = seen[a], seen[b]
        assert abs(mean_a - mean_b) < 4.5 * np.sqrt(variance_a + variance_b), (a, b, seen)


@pytest.mark.parametrize("name", ["triangle", "mesh", "disk", "sphere", "spheres", "constant sky", "image sky"])
def test_every_sample_has_the_pdf_of_its_direction(name):
    """Sampled directions are traced, and the pdf asked for anew must be the one returned."""
    context = renderer(lit_scene(name))._context
    n = 4000
    point, normal = np.repeat([[1.1], [1e-3], [0.2]], n, axis=1), np.repeat([[0.0], [1.0], [0.0]], n, axis=1)
    light = np.full(n, context.lights.count - 1)
    found = context.lights.sample(light, point, normal, *RNG.random((3, n)))
    assert np.allclose(np.linalg.norm(found.wi, axis=0), 1.0, rtol=1e-12)
    if name.endswith("sky"):
        again = context.lights.infinite[0].pdf(found.wi, normal)
        assert np.allclose(again, found.pdf, rtol=1e-6)
        return
    hits = context.closest(point, found.wi)
    unhidden = np.isclose(hits.t, found.distance, rtol=1e-6)
    met = np.flatnonzero((hits.primitive_id >= 0) & unhidden)
    assert met.size > 0.4 * n
    hits = hits.take(met)
    surface = context.surface(point[:, met], found.wi[:, met], hits)
    again = context.lights.pdf(surface, point[:, met], hits.t)
    assert np.allclose(again, found.pdf[met], rtol=1e-6)


@pytest.mark.parametrize("name", ["triangle", "disk", "sphere", "sphere close by", "constant sky", "image sky"])
def test_pdfs_integrate_to_one(name):
    """Over 400,000 even directions, those that reach the light having its pdf, 4 pi pdf is 1 on average."""
    shapes, lights = LIGHTS[name]
    context = renderer(scene(shapes, MATERIALS, lights))._context
    rng = np.random.default_rng(11)
    n = 400_000
    direction = unit_rows(rng.normal(size=(n, 3))).T.copy()
    origin, normal = np.repeat([[0.3], [0.0], [0.1]], n, axis=1), np.repeat([[0.0], [1.0], [0.0]], n, axis=1)
    pdf = np.zeros(n)
    if lights:
        pdf = context.lights.infinite[0].pdf(direction, normal)
    else:
        hits = context.closest(origin, direction)
        met = np.flatnonzero(hits.primitive_id >= 0)
        hits = hits.take(met)
        surface = context.surface(origin[:, met], direction[:, met], hits)
        pdf[met] = context.lights.pdf(surface, origin[:, met], hits.t)
    values = 4 * np.pi * pdf
    assert abs(values.mean() - 1.0) < 4.5 * values.std() / np.sqrt(n)


def test_the_lights_come_in_the_order_of_the_specification():
    """Entries first, then emitting shapes: each sphere of a set, a mesh as a whole, no plane and no empty face."""
    two = SphereSet(np.array([[0.0, 5.0, 0.0], [3.0, 5.0, 0.0]]), np.array([1.0, 1.0]), 1)
    mesh = box_mesh((8, 8, 8), (9, 9, 9))
    mesh.materials[:4] = 1
    empty = Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), 1)
    plane = Plane((0.0, -9.0, 0.0), (0.0, 1.0, 0.0), 1)
    sky, lamp = EnvironmentLight((1.0, 1.0, 1.0)), PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    lights = renderer(scene([plane, empty, two, mesh, TRIANGLE], MATERIALS, [sky, lamp]))._context.lights
    assert lights.count == 2 + 2 + 1 + 1
    assert lights.delta.tolist() == [False, True, False, False, False, False]
    assert lights._light.tolist() == [-1, -1, 2, 3, 4, 4, 4, 4] + [-1] * 8 + [5]
