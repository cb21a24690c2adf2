"""How one light of many is chosen: the mean stays, probabilities are what they are said to be, and the jitted engines choose
as the NumPy engine does.
"""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.light_cells import STEPS as PROBABILITY_STEPS
from engines.light_cells import alias_tables
from engines.numpy_reference.direct_light import EVEN, STEPS, resample_light, sample_light
from engines.scene import (
    Cylinder,
    Dielectric,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    ImageTexture,
    Material,
    Mesh,
    Mixture,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SphereSet,
    SpotLight,
    Triangle,
)
from engines.scene.light_bounds import light_bounds, light_shares
from engines.scene.light_hierarchy import light_hierarchy

RNG = np.random.default_rng(7)
CHOSEN = ["power", "bvh", "spatial"]
"""Every value of `light_sampler` but `uniform`."""
RULES = [("power", 1), ("bvh", 1), ("spatial", 1), ("uniform", 4), ("bvh", 3), ("spatial", 2)]
"""Values of `light_sampler` and `light_candidates`."""
FLOOR, GLASS, LAMP, GLOW, DIM = range(5)
MATERIALS = (
    Material("floor", bsdf=Mixture(kd=ImageTexture(RNG.uniform(0.2, 0.8, (4, 4, 3)).astype(np.float32)), ks=(0.1,) * 3)),
    Material("glass", bsdf=Dielectric(1.4, (0.4, 0.3))),
    Material("lamp", emission=(7.0, 6.0, 5.0)),
    Material("glow", kd=(0.3,) * 3, emission=(1.0, 2.0, 3.0), two_sided=True),
    Material("dim", emission=(0.0, 0.02, 0.01)),
)
SKY = RNG.random((4, 8, 3)) ** 4
CAMERA = Perspective((0.3, -4.0, 2.2), (0.0, 0.0, 0.6), (0.0, 0.0, 1.0), 52.0, "y", (24, 24))


def every_light(opaque=False):
    """Lights of every kind and of very different power, and shapes that they light."""
    corners = np.array([(-1.4, 0.9, 1.2), (-0.9, 1.0, 1.0), (-0.8, 0.7, 1.7), (-1.5, 0.6, 1.9)])
    shapes = (
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), FLOOR),
        Sphere((0.6, 0.3, 0.5), 0.5, FLOOR if opaque else GLASS),
        Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32), np.array([LAMP, GLOW, FLOOR], np.int32)),
        Triangle((1.2, 1.0, 1.5), (1.3, 1.1, 1.5), (1.2, 1.2, 1.7), LAMP),
        Disk((0.0, -0.5, 3.0), (0.0, 0.0, -1.0), 0.8, DIM),
        SphereSet(np.array([[-1.2, -0.9, 0.2], [1.4, -0.8, 0.15], [0.1, -0.9, 1.4]]), np.array([0.1, 0.05, 0.2]), GLOW),
        Cylinder((-0.2, 1.3, 0.4), (0.3, 1.2, 0.5), 0.06, LAMP),
    )
    lights = (
        PointLight((0.0, 0.0, 2.0), (0.5, 0.4, 0.3)),
        PointLight((2.0, 0.0, 2.0), (0.05, 0.05, 0.1), falloff=False),
        SpotLight((-1.0, -1.0, 1.5), (0.6, 0.48, -0.64), (2.0, 1.0, 1.0), 35.0, 20.0),
        DirectionalLight((0.0, 0.6, -0.8), (0.1, 0.1, 0.05)),
        EnvironmentLight((0.2, 0.2, 0.3), SKY),
    )
    return Scene("every light", CAMERA, MATERIALS, shapes, lights, "")


def path_tracer(light_sampler, **options):
    return {"name": "path_tracer", "max_depth": 3, "rr_depth": 1000, "light_sampler": light_sampler, **options}


def render(engine, scene, spp=2, **settings):
    film = engines.engine(engine).prepare(scene, Settings(**{"seed": 5, "threads": 1, **settings})).render(spp)
    assert film.bad_samples == 0
    return film.mean()


@pytest.mark.parametrize(("name", "candidates"), RULES)
def test_numba_in_float64_equals_the_reference_however_lights_are_chosen(name, candidates):
    for direct in ("mis", "light", *(["bsdf"] if candidates > 1 else [])):
        settings = {"shader": path_tracer(name, direct=direct, light_candidates=candidates), "sampler": "sobol"}
        reference = render("numpy", every_light(), **settings)
        found = render("numba", every_light(), precision="float64", accelerator="bvh", **settings)
        difference = np.abs(found - reference).max(axis=2) / reference.max()
        assert reference.max() > 0.1
        assert (difference < 1e-8).all(), np.argwhere(difference >= 1e-8)


@pytest.mark.parametrize("direct", ["mis", "light"])
@pytest.mark.parametrize(("name", "candidates"), RULES)
def test_the_mean_does_not_depend_on_how_lights_are_chosen(name, candidates, direct):
    """By z of every block of 6 x 6 pixels over pairs of independent images, of numba, which equals the reference here."""
    settings, blocks = {"precision": "float64", "accelerator": "bvh", "sampler": "random"}, []
    for seed in range(24):
        rules = (("uniform", 1), (name, candidates))
        shaders = [path_tracer(choice, direct=direct, light_candidates=count) for choice, count in rules]
        images = [
            render("numba", every_light(), 4, seed=2 * seed + k, shader=shader, **settings) for k, shader in enumerate(shaders)
        ]
        blocks.append((images[1] - images[0]).mean(axis=2).reshape(4, 6, 4, 6).mean(axis=(1, 3)))
    mean, error = np.mean(blocks, axis=0), np.std(blocks, axis=0, ddof=1) / math.sqrt(len(blocks))
    assert (np.abs(mean) < 4.5 * error).all(), mean / error
    assert abs(np.mean(blocks)) < 0.02, np.mean(blocks)


def test_a_light_alone_and_shaders_of_all_lights_are_left_as_they_are():
    lamp = Scene("one", CAMERA, MATERIALS, every_light().shapes[:2], every_light().lights[:1], "")
    for name in CHOSEN:
        settings = {"sampler": "sobol", "spp": 1}
        even, other = (render("numpy", lamp, shader=path_tracer(choice), **settings) for choice in ("uniform", name))
        assert np.array_equal(even, other)


@pytest.mark.parametrize("opaque", [True, False])
def test_resampled_light_has_the_mean_of_its_candidates(opaque):
    """At each point by 4096 numbers in equal steps that pick: the mean of what is picked is that of the candidates, but for a
    step at each end of each candidate's share."""
    context, steps, count = context_of(every_light(opaque), "bvh"), 4096, 8
    pick, numbers = (np.arange(steps) + 0.5) / steps, np.random.default_rng(11)
    for point, normal in zip(*(vectors.T for vectors in vertices(12)), strict=True):
        at = SimpleNamespace(
            point=np.repeat(point[:, None], steps, axis=1),
            normal=np.repeat(normal[:, None], steps, axis=1),
            geometric=np.repeat(normal[:, None], steps, axis=1),
        )
        at.cosine = lambda wi, at=at: np.abs((at.normal * wi).sum(axis=0))
        at.faces = lambda wi, at=at: (at.geometric * wi).sum(axis=0) > 0.0
        at.take = lambda lanes, at=at: SimpleNamespace(**{k: getattr(at, k)[:, lanes] for k in ("point", "normal")})
        u0, u1, u = (np.full(steps, x) for x in numbers.random(3))
        found = resample_light(context, at, u0, u1, u, pick, count)
        places = [[(x + k * step / 2**24) % 1.0 for x, step in zip((u0, u1), STEPS, strict=True)] for k in range(count)]
        every = [sample_light(context, at, *places[k], (k + u) / count) for k in range(count)]
        cosine = [np.abs((at.normal * one.light.wi).sum(axis=0)) for one in every]
        above = [1.0 if context.lit_through else (at.geometric * one.light.wi).sum(axis=0) > 0.0 for one in every]
        added = [(one.light.weight * one.scale * cosine[k] * above[k])[:, 0] for k, one in enumerate(every)]
        mean = np.mean(added, axis=0)
        seen = (found.light.weight * found.scale * np.abs((at.normal * found.light.wi).sum(axis=0))).mean(axis=1)
        largest = (found.light.weight * found.scale).max(initial=0.0)
        assert np.abs(seen - mean).max() <= 2 * count * largest / steps
        assert (found.scale > 0.0).any() == (mean > 0.0).any()
        assert (found.scale <= found.inverse_pmf / EVEN * (1 + 1e-9)).all()


def vertices(n):
    """Points (3, n) around the lights and unit normals (3, n)."""
    rng = np.random.default_rng(3)
    normal = rng.normal(size=(3, n))
    return rng.uniform((-2.0, -2.0, 0.0), (2.0, 2.0, 2.5), (n, 3)).T, normal / np.linalg.norm(normal, axis=0)


def context_of(scene, name):
    renderer = engines.engine("numpy").prepare(scene, Settings(shader=path_tracer(name), width=1, height=1))
    renderer.render(1)  # which learns
    return renderer._context


@pytest.mark.parametrize("opaque", [True, False])
@pytest.mark.parametrize("name", ["uniform", *CHOSEN])
def test_lights_are_chosen_as_often_as_their_probability_says(name, opaque):
    """At each point by 4096 numbers in equal steps: the share of each light is its probability, but for a step at each end of
    each interval in which the light is chosen: one, or a part of each bin."""
    context, steps = context_of(every_light(opaque), name), 4096
    count, sampler = context.lights.count, context.light_sampler
    for point, normal in zip(*(vectors.T for vectors in vertices(60)), strict=True):
        places = [np.repeat(vector[:, None], steps, axis=1) for vector in (point, normal)]
        found = sampler.choose(*places, (np.arange(steps) + 0.5) / steps)
        every = np.arange(count)
        probability = 1.0 / sampler.inverse_pmf(every, *(vector[:, :count] for vector in places))
        assert (found.light < count).all() and (found.uc >= 0.0).all() and (found.uc < 1.0).all()
        seen = np.bincount(found.light[found.light >= 0], minlength=count) / steps
        intervals = 16 if name == "spatial" else 1
        assert np.abs(seen - probability).max() <= intervals / steps
        assert probability.sum() + (found.light < 0).mean() == pytest.approx(1.0, abs=count / steps)
        chosen = found.light >= 0
        assert np.allclose(1.0 / found.inverse_pmf[chosen], probability[found.light[chosen]], rtol=1e-9)


@pytest.mark.parametrize("opaque", [True, False])
@pytest.mark.parametrize("name", CHOSEN)
def test_every_light_that_reaches_a_surface_may_be_chosen(name, opaque):
    context, n = context_of(every_light(opaque), name), 3000
    rng, (point, normal) = np.random.default_rng(4), vertices(n)
    for light in range(context.lights.count):
        chosen = np.full(n, light)
        sample = context.lights.sample(chosen, point, normal, *rng.random((3, n)))
        reaches = (sample.weight > 0.0).any(axis=0)
        if opaque:
            reaches &= (normal * sample.wi).sum(axis=0) > 0.0
        assert np.isfinite(context.light_sampler.inverse_pmf(chosen, point, normal)[reaches]).all(), light


def test_the_bounds_of_a_hierarchy_hold_all_lights_below():
    """Of a thousand spheres and disks: each is in one place, powers add up, and spheres and cones hold those below."""
    rng = np.random.default_rng(5)
    normals = rng.normal((0.0, 0.0, 2.0), size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    disks = [Disk(tuple(rng.random(3)), tuple(normal), 0.02, LAMP) for normal in normals]
    spheres = SphereSet(rng.random((700, 3)), rng.uniform(0.001, 0.1, 700), LAMP)
    scene = Scene("many", CAMERA, MATERIALS, (spheres, *disks), (), "")
    tree, bounds = light_hierarchy(scene), light_bounds(scene)
    assert sorted(-1 - tree.child[(tree.child < 0) & (tree.power > 0.0)]) == list(range(1000))
    power = np.zeros_like(tree.power)
    for j, light in enumerate(bounds):
        place, corners = int(tree.place[j]), np.array(list(itertools.product(*light.box.T)))
        assert tree.child.flat[place] == -1 - j
        while place >= 0:
            node, slot = divmod(place, 8)
            power[node, slot] += light.power
            away = np.linalg.norm(corners - tree.center[node, slot], axis=1)
            assert away.max() <= tree.radius[node, slot] * (1.0 + 1e-12)
            axis = tree.axis[node, slot]
            angle = math.atan2(np.linalg.norm(np.cross(light.axis, axis)), light.axis @ axis)
            assert min(angle + light.spread, math.pi) <= tree.spread[node, slot] + 1e-9
            assert light.reach <= tree.reach[node, slot]
            assert node == 0 or tree.child.flat[tree.parent[node]] == node
            place = int(tree.parent[node])
    assert np.allclose(power, tree.power)


def test_powers_are_what_lights_send_out():
    names = ("point", "constant", "spot", "sun", "sky", "mesh", "triangle", "disk")
    found = dict(zip(names, light_bounds(every_light()), strict=False))
    assert found["point"].power == pytest.approx(4 * math.pi * 0.4)
    assert found["triangle"].power == pytest.approx(math.pi * 6 * math.sqrt(0.0012) / 2)
    assert found["disk"].power == pytest.approx(math.pi * 0.01 * math.pi * 0.64)
    assert len(light_bounds(every_light())) == 12
    assert light_shares(every_light()).sum() == pytest.approx(1.0)
    assert (light_shares(every_light()) > 0.0).all()
    # a cutoff equal to the beam: intensity times the cone's solid angle
    spot = SpotLight((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (3.0,) * 3, 60.0, 60.0)
    cone = light_bounds(Scene("spot", CAMERA, MATERIALS, (), (spot,), ""))[0]
    assert cone.power == pytest.approx(3.0 * 2 * math.pi * (1 - math.cos(math.pi / 3)))


def test_lights_without_power_are_never_chosen_and_black_scenes_stay_black():
    dark = PointLight((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
    shares = light_shares(Scene("dark", CAMERA, MATERIALS, (), (dark, every_light().lights[0], dark), ""))
    assert shares.tolist() == [0.0, 1.0, 0.0]
    black = Scene("black", CAMERA, MATERIALS, every_light().shapes[:1], (dark, dark), "")
    for name in CHOSEN:
        assert not render("numpy", black, shader=path_tracer(name), sampler="sobol").any()


def test_alias_tables_hold_exactly_the_probabilities_that_they_are_made_of():
    rng = np.random.default_rng(2)
    for count in (2, 3, 8, 375):
        share = rng.random((40, count)) ** 8 * (rng.random((40, count)) > 0.3) + 1e-9 * (np.arange(count) == 0)
        share /= share.sum(axis=1, keepdims=True)
        steps = np.floor(share * PROBABILITY_STEPS).astype(np.int64)
        steps[np.arange(40), share.argmax(axis=1)] += PROBABILITY_STEPS - steps.sum(axis=1)
        own, other, of_own, of_other = alias_tables(steps).astype(np.int64).transpose(2, 0, 1)
        row, bins = np.arange(40)[:, None], own.shape[1]
        assert ((own >= 0) & (own <= PROBABILITY_STEPS // bins)).all()
        found = own.copy()
        np.add.at(found, (row, other), PROBABILITY_STEPS // bins - own)
        wanted = np.pad(steps, ((0, 0), (0, bins - count)))
        assert np.array_equal(found, wanted) and np.array_equal(of_own, wanted)
        assert np.array_equal(of_other, wanted[row, other])


@pytest.mark.parametrize("engine", ["numba", "embree", "numpy"])
def test_cells_of_lights_depend_on_the_scene_alone(engine):
    """The same bits, whatever the threads, wherever calls are split, and after an update."""
    scene, shader = every_light(), path_tracer("spatial")
    found = []
    for threads, calls in ((1, [3]), (2, [1, 2])):
        renderer = engines.engine(engine).prepare(scene, Settings(shader=shader, seed=5, threads=threads))
        for spp in calls:
            renderer.render(spp)
        found.append(renderer.film.mean())
    renderer.update(shapes=scene.shapes[:3])
    renderer.render(1)
    renderer.update(shapes=scene.shapes)
    renderer.render(3)
    found.append(renderer.film.mean())
    assert all(np.array_equal(image, found[0]) for image in found)


def test_a_cell_knows_the_light_beside_it_and_one_side_from_the_other():
    """Two equal bulbs on either side of a wall: near each of them, the other is hardly chosen."""
    wall = Mesh(np.array([[0, -9, -9], [0, 9, -9], [0, 9, 9], [0, -9, 9.0]]), np.array([[0, 1, 2], [0, 2, 3]]), FLOOR)
    bulbs = [Sphere((x, 0.0, 0.0), 0.05, LAMP) for x in (-0.5, 0.5)]
    opaque = tuple(material for material in MATERIALS if material.name != "glass")
    lamp = [material.name for material in opaque].index("lamp")
    bulbs = [replace(bulb, material=lamp) for bulb in bulbs]
    sampler = context_of(Scene("wall", CAMERA, opaque, (wall, *bulbs), (), ""), "spatial").light_sampler
    point = np.array([[0.0, 0.1, 0.0]] * 2).T
    for side, light in ((-1.0, 0), (1.0, 1)):
        facing = np.array([[side, 0.0, 0.0]] * 2).T
        assert 1.0 / sampler.inverse_pmf(np.array([light]), point[:, :1], facing[:, :1]) > 0.9
