"""Conductors, disks, planes and lights in Mitsuba: what reaches it is what the scene says, against closed forms."""

import math

import numpy as np
import pytest

import engines
from engines import Settings
from engines.peers.export import export
from engines.scene.frames import facing
from engines.scene.metals import METALS
from tests.mitsuba.peer import mi
from tests.needs import marks_of, needs

pytestmark = needs("mitsuba-scalar")

CAMERA = {"type": "orthographic", "eye": [0, 0, 5], "target": [0, 0, 0], "height": 0.01}
FLOOR = {"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 2}, "material": "floor"}
ENGINES = [pytest.param(name, marks=marks_of(name)) for name in ("mitsuba", "mitsuba_scalar")]


def scene(material, shapes=(), lights=()):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": CAMERA,
            "materials": {"floor": material, "lamp": {"emission": [3, 2, 1]}, "both": {"emission": 1, "two_sided": True}},
            "shapes": [FLOOR, *shapes],
            "lights": [*lights],
        }
    )


def mean(engine, scene, spp=16, shader="path_tracer"):
    settings = Settings(4, 4, shader=shader, sampler="random", precision="float32", threads=2, seed=1)
    return engines.engine(engine).prepare(scene, settings).render(spp).mean().mean(axis=(0, 1))


@pytest.mark.parametrize("name", METALS)
def test_the_indices_of_a_metal_are_those_that_mitsuba_evaluates(name):
    mi.set_variant("scalar_rgb")
    found = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
    for key, listed in zip(("eta", "k"), METALS[name], strict=True):
        assert np.allclose(np.ravel(found[f"{key}.value"]), listed, atol=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_smooth_conductor_shows_the_sky_times_its_albedo(engine):
    held = scene({"conductor": {"metal": "Au", "specular_reflectance": 0.5}}, lights=[{"environment": {"radiance": 2}}])
    assert np.allclose(mean(engine, held), 2 * np.array(held.materials[0].bsdf.albedo), rtol=1e-4)
    assert np.allclose(mean(engine, held, shader="albedo"), held.materials[0].bsdf.albedo, rtol=1e-5)


def specular_value(alpha, toward_light):
    """f cos of a white GGX conductor seen along its normal (Walter et al. 2007, equations 20, 33 and 34), isotropic."""
    half = np.add((0, 0, 1), toward_light)
    cos_half, cos = half[2] / np.linalg.norm(half), toward_light[2]
    d = alpha**2 / (math.pi * (cos_half**2 * (alpha**2 - 1) + 1) ** 2)
    g = 2 / (1 + math.sqrt(1 + alpha**2 * (1 / cos**2 - 1)))
    return d * g / 4


@pytest.mark.parametrize("engine", ENGINES)
def test_a_rough_conductor_reflects_a_spot_light_by_its_formula(engine):
    angle, distance = math.radians(30), 2.0
    toward_light = np.array([math.sin(angle), 0, math.cos(angle)])
    spot = {"position": (distance * toward_light).tolist(), "target": [0, 0, 0], "intensity": [1, 2, 3]}
    held = scene({"conductor": {"reflectance": [1, 0.5, 1], "alpha": 0.4}}, lights=[{"spot": spot}])
    expected = specular_value(0.4, toward_light) * np.array([1, 1, 3]) / distance**2
    assert np.allclose(mean(engine, held), expected, rtol=5e-3)


@pytest.mark.parametrize("axis", [0, 1])
@needs("mitsuba-llvm")
def test_the_first_roughness_is_along_the_first_tangent(axis):
    """Of a triangle from its first corner to its second; the rougher way spreads light further off the mirror direction."""
    triangle = {"triangle": {"a": [-5, -2, 0], "b": [5, -2, 0], "c": [0, 5, 0]}, "material": "floor"}
    light = {"directional": {"direction": [-0.5 if axis == 0 else 0, -0.5 if axis == 1 else 0, -1], "irradiance": 1}}
    values = []
    for alpha in ([0.5, 0.05], [0.05, 0.5]):
        held = engines.scene_from(
            {
                "raybench_scene": 1,
                "camera": CAMERA,
                "shapes": [triangle],
                "lights": [light],
                "materials": {"floor": {"conductor": {"reflectance": 1, "alpha": alpha}}},
            }
        )
        values.append(mean("mitsuba", held)[0])
    assert (values[0] > 10 * values[1]) == (axis == 0), values


@pytest.mark.parametrize(("degrees", "share"), [(5, 1.0), (19.9, 1.0), (25, 0.5), (29, 0.1), (30.5, 0.0)])
@needs("mitsuba-llvm")
def test_a_spot_light_falls_off_linearly_in_the_angle(degrees, share):
    angle = math.radians(degrees)
    axis = [math.sin(angle), 0, -math.cos(angle)]
    spot = {"position": [0, 0, 2], "direction": axis, "intensity": math.pi, "cutoff": 30, "beam_width": 20}
    expected = 0.5 * share / 4
    assert np.allclose(mean("mitsuba", scene({"kd": 0.5}, lights=[{"spot": spot}])), expected, rtol=2e-2, atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_disk_lights_what_it_faces(engine):
    """Irradiance on the axis of a disk of radiance L: pi L r^2 / (r^2 + h^2)."""
    above = {"disk": {"center": [0, 0, 6], "normal": [0, 0, -2], "radius": 3}, "material": "lamp"}
    lit, away = (mean(engine, scene({"kd": 0.5}, [above]), 256), {**above, "disk": {**above["disk"], "normal": [0, 0, 1]}})
    assert np.allclose(lit, 0.5 * np.array([3, 2, 1]) * 9 / (9 + 36), rtol=0.02)
    assert np.all(mean(engine, scene({"kd": 0.5}, [away])) == 0)
    both = {**away, "material": "both"}
    assert np.allclose(mean(engine, scene({"kd": 0.5}, [both]), 256), 0.5 * 9 / (9 + 36), rtol=0.02)


@needs("mitsuba-llvm")
def test_rays_hit_a_disk_inside_its_radius_and_nowhere_else():
    held = scene({"kd": 0.5})
    renderer = engines.engine("mitsuba").prepare(held, Settings(4, 4, sampler="random", precision="float32"))
    x = np.array([0.0, 1.4, 1.99, 2.01, -1.5])
    origins = np.stack([x, np.where(np.abs(x) > 1.41, 0, x), np.full(5, 3.0)], axis=1)
    hits = renderer.trace(origins, np.tile([0, 0, -1.0], (5, 1)))
    assert hits.shape.tolist() == [0, 0, 0, -1, 0] and hits.primitive.tolist() == [0, 0, 0, -1, 0]
    assert np.allclose(hits.t[[0, 1, 2, 4]], 3) and np.allclose(hits.normal[0], [0, 0, 1])


@needs("mitsuba-llvm")
def test_an_exported_file_gives_mitsuba_the_same_image(tmp_path):
    spot = {"position": [0.5, 0, 2], "target": [0, 0, 0], "intensity": 5}
    above = {"disk": {"center": [0, 0, 6], "normal": [0, 0, -1], "radius": 3}, "material": "lamp"}
    held = scene({"conductor": {"metal": "Cu", "alpha": [0.3, 0.5]}}, [above], [{"spot": spot}])
    file = export(held, "mitsuba", tmp_path / "scene.xml")
    mi.set_variant("scalar_rgb")
    theirs = np.array(mi.render(mi.load_file(str(file)), spp=4)).mean(axis=(0, 1))
    assert np.allclose(theirs, mean("mitsuba", held, 256), rtol=0.05)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (0, 1, 0), (-0.48, 0.6, -0.64), (0.6, 0, -0.8)])
def test_a_transform_that_faces_a_normal_is_a_rotation(normal):
    matrix = facing((1, 2, 3), normal, 1.0)
    assert np.allclose(matrix @ [0, 0, 1, 0], [*normal, 0]) and np.allclose(matrix @ [0, 0, 0, 1], [1, 2, 3, 1])
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3)) and np.linalg.det(matrix) == pytest.approx(1)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("normal", [(0, 0, 1), (0.3, 0.2, 1), (0, -0.5, 1), (0.4, 0.1, 0.5)])
def test_a_tilted_plane_does_not_shadow_itself(engine, normal):
    """Every pixel of a diffuse plane under a point light, in closed form."""
    light, side = np.array([1.0, 1.0, 4.0]), 16
    held = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {**CAMERA, "height": 1},
            "materials": {"floor": {"kd": 0.5}},
            "shapes": [{"plane": {"point": [0, 0, 0], "normal": normal}, "material": "floor"}],
            "lights": [{"point": {"position": light.tolist(), "intensity": math.pi}}],
        }
    )
    settings = Settings(side, side, sampler="random", precision="float32", threads=2)
    found = engines.engine(engine).prepare(held, settings).render(4).mean()[:, :, 0]
    x = (np.arange(side) + 0.5) / side - 0.5
    unit = np.array(normal) / np.linalg.norm(normal)
    points = np.stack([*np.meshgrid(x, -x), np.zeros((side, side))], axis=-1)
    points[..., 2] = -(points[..., :2] @ unit[:2]) / unit[2]
    away = light - points
    distance = np.linalg.norm(away, axis=-1)
    assert np.allclose(found, 0.5 * (away @ unit) / distance**3, rtol=0.05)


@needs("mitsuba-llvm")
def test_ambient_light_is_for_diffuse_lobes_alone():
    shader = {"name": "whitted", "ambient": 0.3}
    assert np.allclose(mean("mitsuba", scene({"kd": 0.5}), shader=shader), 0.15, rtol=1e-4)
    assert np.all(mean("mitsuba", scene({"conductor": {"metal": "Au", "alpha": 0.3}}), shader=shader) == 0)


@needs("mitsuba-llvm")
def test_an_anisotropic_plane_is_declined_by_name():
    plane = {"plane": {"point": [0, 0, -1], "normal": [0, 0, 1]}, "material": "floor"}
    held, even = (scene({"conductor": {"metal": "Au", "alpha": alpha}}, [plane]) for alpha in ([0.1, 0.2], 0.1))
    reason = engines.engine("mitsuba").why_not(held, Settings(4, 4, sampler="random"))
    assert reason == "material 'floor': Mitsuba does not support an anisotropic conductor on a plane"
    assert engines.engine("mitsuba").why_not(even, Settings(4, 4, sampler="random")) is None
