"""Lights that show a texture, spot lights and projectors: a floor in closed form, and the kernels against the NumPy engine."""

import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, save_scene
from engines.errors import SceneError, Unsupported
from engines.kernels.flatten.scene import flatten
from engines.peers import cycles, luxcore
from engines.peers.export import export
from engines.scene import (
    Checkerboard,
    Diffuse,
    ImageTexture,
    Material,
    Perspective,
    Plane,
    PointLight,
    ProjectorLight,
    Scene,
    Sphere,
    SpotLight,
    Triangle,
)
from engines.scene.content import content_hash
from engines.scene.light_bounds import light_bounds
from tests.needs import marks_of
from tests.numpy_reference.small_scenes import point_view, renderer

MIDDLE = {"name": "constant", "value": 0.5}
QUARTERS = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [4, 4, 4]]], np.float32)
RED, GREEN, BLUE, WHITE, BLACK = (1, 0, 0), (0, 1, 0), (0, 0, 1), (4, 4, 4), (0, 0, 0)
GREY = Material("grey", bsdf=Diffuse((0.5, 0.5, 0.5)))
FLOOR = Triangle((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 18.0, 0.0), 0)
PATHS = {"name": "path_tracer", "max_depth": 2, "rr_depth": 100}
DOWN, NORTH = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
ENGINES = [
    pytest.param(engine, precision, tolerance, marks=marks_of(engine))
    for engine, precision, tolerance in (
        ("numpy", "float64", 1e-9),
        ("embreex_batch", "float64", 1e-5),
        ("numba", "float64", 1e-9),
        ("embree", "float32", 1e-5),
    )
]


def quarters(**keys):
    return ImageTexture(QUARTERS, "nearest", **keys)


def high(rows):
    """The four colours, each `rows` rows high and a texel wide."""
    return ImageTexture(QUARTERS.repeat(rows, axis=0), "nearest")


def unit(*vector):
    return tuple(float(x) for x in np.divide(vector, np.linalg.norm(vector)))


def scene(*lights, camera=None, shapes=(FLOOR,), materials=(GREY,)):
    camera = camera or point_view((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    return Scene("lit", camera, materials, shapes, lights, content_hash(camera, materials, shapes, lights))


def rendered(held, engine="numpy", precision="float64", spp=1, sampler="sobol", **shader):
    settings = Settings(shader=PATHS | shader, precision=precision, sampler=sampler, seed=3)
    return engines.engine(engine).prepare(held, settings).render(spp).mean()


def floor(light, places, engine="numpy", precision="float64"):
    """(n, 3) radiance of the floor at n points."""
    views = [scene(light, camera=point_view((x, y, 1.0), (x, y, 0.0))) for x, y in places]
    return np.array([rendered(view, engine, precision, sampler=MIDDLE)[0, 0] for view in views])


def projector(**keys):
    """2 m above the origin. Its image is 2 m wide there, and has a row for each 2 m: 1 m and 0.5 m at a distance of 1 m."""
    given = {
        "direction": DOWN,
        "up": NORTH,
        "irradiance": (3.0, 2.0, 1.0),
        "texture": quarters(),
        "fov": 2.0 * math.degrees(math.atan(0.5)),
    }
    return ProjectorLight((0.0, 0.0, 2.0), **{**given, "fov_axis": "x", **keys})


# As a camera sees it that looks down with north up: east is to the right.
AROUND = {(-0.5, 0.5): RED, (0.5, 0.5): GREEN, (-0.9, -0.9): BLUE, (0.1, -0.99): WHITE, (1.01, 0.0): BLACK, (0.0, -1.01): BLACK}


@pytest.mark.parametrize(("engine", "precision", "tolerance"), ENGINES)
def test_a_projector_lights_a_floor_in_the_colours_of_its_image(engine, precision, tolerance):
    """Everywhere irradiance / h^2: 0.5/pi (3, 2, 1)/4 times the colour."""
    expected = np.array([*AROUND.values()]) * [3, 2, 1] * 0.5 / np.pi / 4
    assert np.allclose(floor(projector(), AROUND, engine, precision), expected, rtol=tolerance)


@pytest.mark.parametrize(
    ("keys", "width", "height"),
    [
        ({"texture": high(2)}, 2.0, 4.0),
        ({"texture": high(2), "fov_axis": "y"}, 1.0, 2.0),
        ({"texture": ImageTexture(QUARTERS.repeat(3, axis=1), "nearest"), "fov_axis": "y"}, 6.0, 2.0),
        ({"texture": Checkerboard(), "fov_axis": "y"}, 2.0, 2.0),
    ],
)
def test_the_image_of_a_projector_keeps_its_shape(keys, width, height):
    edges = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)]) * (width / 2, height / 2)
    inside, outside = (floor(projector(**keys), edges * share) for share in (0.99, 1.01))
    assert inside.any(axis=1).all() and not outside.any()


def test_a_projector_turns_with_its_up():
    """East is up: north is to the left."""
    expected = np.array([RED, GREEN, BLUE]) * [3, 2, 1] * 0.5 / np.pi / 4
    assert np.allclose(floor(projector(up=(1.0, 0.0, 0.0)), [(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5)]), expected)


def test_a_tilted_projector_lights_a_floor_by_its_depth_and_cosines():
    """irradiance / (z^2 cos(theta)) times the cosine at the floor; z along the axis, theta from it."""
    axis, way = np.array(unit(0.6, 0.0, -0.8)), np.array([0.9, 0.2, -2.0])
    light = projector(direction=unit(*axis), texture=ImageTexture(QUARTERS[1:, 1:], "nearest"), fov=70.0)
    distance, depth = np.linalg.norm(way), way @ axis
    expected = 0.5 / np.pi * 4.0 * np.array([3, 2, 1]) / (depth**2 * depth / distance) * 2.0 / distance
    assert np.allclose(floor(light, [(0.9, 0.2)]), expected, rtol=1e-9)


def test_behind_it_a_projector_is_black():
    lights = renderer(scene(projector()))._context.lights
    points = np.array([[0.1, 0.1, 5.0, 0.0], [0.1, -0.1, 0.0, 0.0], [3.0, 2.5, 2.0, 1.9]])
    none = np.zeros(4)
    found = lights.sample(np.zeros(4, int), points, 0.0 * points, none, none, none)
    assert not found.weight[:, :3].any() and found.weight[:, 3].any() and np.isinf(found.pdf).all()


@pytest.mark.parametrize(("engine", "precision", "tolerance"), ENGINES)
def test_the_texture_of_a_spot_light_fills_the_square_around_its_cone(engine, precision, tolerance):
    """Of half angle 45 degrees, 2 m above the floor: intensity cos^3 / h^2 times the falloff and the colour."""
    light = SpotLight((0.0, 0.0, 2.0), DOWN, (3.0, 2.0, 1.0), 45.0, 15.0, quarters(), NORTH)
    places = {(-0.4, 0.4): RED, (1.3, 1.3): GREEN, (-1.0, -0.1): BLUE, (0.01, -1.9): WHITE, (1.5, 1.5): BLACK}
    angle = np.arctan(np.linalg.norm([*places], axis=1) / 2.0)
    share = np.cos(angle) ** 3 / 4.0 * np.clip((45.0 - np.degrees(angle)) / 30.0, 0.0, 1.0)
    expected = 0.5 / np.pi * np.array([*places.values()]) * [3, 2, 1] * share[:, None]
    assert np.allclose(floor(light, places, engine, precision), expected, rtol=tolerance)


def test_a_white_texture_leaves_a_spot_light_as_it_is():
    plain = SpotLight((0.0, 0.0, 2.0), unit(0.2, 0.1, -1.0), (3.0, 2.0, 1.0), 45.0, 15.0)
    white = replace(plain, texture=ImageTexture(np.ones((3, 2, 1), np.float32)))
    camera = Perspective((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), NORTH, 90.0, "y", (16, 16))
    assert np.array_equal(rendered(scene(plain, camera=camera)), rendered(scene(white, camera=camera)))


# ---- every kind, in kernels --------------------------------------------------------------------------------------------


def every_light():
    """Textures of all kinds, beside lights without, an area light and a texture that emits."""
    image = ImageTexture(
        np.random.default_rng(3).uniform(-0.2, 3.0, (5, 7, 3)).astype(np.float32), to_uv=(0.8, -0.6, 0.17, 0.6, 0.8, -0.31)
    )
    grey = ImageTexture(np.random.default_rng(4).uniform(0.0, 3.0, (3, 4, 1)).astype(np.float32), wrap="clamp")
    lights = (
        PointLight((2.0, 2.0, 1.0), (0.2, 0.2, 0.1)),
        SpotLight((0.0, 0.0, 2.0), unit(0.2, 0.1, -1.0), (1.0, 2.0, 3.0), 35.0, 20.0, image, unit(0.0, 1.0, 0.2)),
        ProjectorLight((1.0, 0.0, 2.0), unit(-0.4, 0.2, -1.0), NORTH, (3.0, 2.0, 1.0), grey, 50.0, "y"),
        ProjectorLight(
            (-1.0, 0.0, 2.0), unit(0.4, -0.2, -1.0), unit(1, 1, 0), (1.0, 2.0, 1.0), Checkerboard((1.0, 1.0, 0.5)), 30.0, "x"
        ),
        SpotLight((0.0, 1.0, 2.0), unit(0.2, 0.1, -1.0), (1.0, 2.0, 3.0), 15.0, 10.0),
    )
    camera = Perspective((0.0, -3.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 50.0, "y", (24, 24))
    shapes = (Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0), Sphere((0.3, 0.2, 0.4), 0.3, 0), Sphere((-1.3, 0.2, 1.4), 0.1, 1))
    return scene(*lights, camera=camera, shapes=shapes, materials=(GREY, Material("lamp", emission=image)))


SHADERS = {
    "uniform": {"light_sampler": "uniform"},
    "power": {"light_sampler": "power"},
    "bvh": {"light_sampler": "bvh", "light_candidates": 4},
    "spatial": {"light_sampler": "spatial"},
}


@pytest.mark.parametrize(
    "shader", [*({**PATHS, **each} for each in SHADERS.values()), {"name": "whitted"}], ids=[*SHADERS, "whitted"]
)
def test_the_kernels_equal_the_numpy_engine_on_every_light_that_shows_a_texture(shader):
    settings = Settings(shader=shader, precision="float64", sampler="sobol", seed=3)
    images = [engines.engine(engine).prepare(every_light(), settings).render(2).mean() for engine in ("numpy", "numba")]
    assert images[0].max() > 1 and np.abs(images[1] - images[0]).max() < 1e-9 * images[0].max()


def test_every_light_sampler_has_the_same_mean():
    means = [rendered(every_light(), "numba", spp=256, **shader).mean(axis=(0, 1)) for shader in SHADERS.values()]
    assert np.abs(np.array(means) / means[0] - 1.0).max() < 0.01


def test_a_scene_without_such_lights_has_no_code_for_them():
    plain, shown = (flatten(scene(light), np.float64, np.float64).features for light in (every_light().lights[4], projector()))
    assert not plain.light_frames and not plain.textures and shown.light_frames


# ---- what chooses lights -------------------------------------------------------------------------------------------------

CONE = SpotLight(
    (0.0, 0.0, 2.0), unit(0.2, 0.1, -1.0), (1.0, 2.0, 3.0), 35.0, 20.0, ImageTexture(np.full((2, 2, 1), 3, np.float32))
)
POWERED = {
    "projector": projector(),
    "high image": projector(texture=high(3), fov=100.0),
    "checkerboard": projector(texture=Checkerboard((1.0, 3.0, 2.0), (0.0, 1.0, 0.0))),
    "spot": replace(CONE, beam_width=35.0),
    "wide spot": replace(CONE, cutoff=89.0, beam_width=89.0),
}


@pytest.mark.parametrize("name", POWERED)
def test_power_and_cone_are_those_of_what_a_light_sends_out(name):
    """Summed over 400,000 directions, evenly spread over the sphere."""
    light, n = POWERED[name], 400_000
    z, phi = 1.0 - (2.0 * np.arange(n) + 1.0) / n, np.arange(n) * math.pi * (3.0 - math.sqrt(5.0))
    directions = np.stack([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z])
    lights, none = renderer(scene(light))._context.lights, np.zeros(n)
    points = np.array(light.position)[:, None] + directions
    sent = lights.sample(np.zeros(n, int), points, directions, none, none, none).weight
    found = light_bounds(scene(light))[0]
    assert found.power == pytest.approx(sent.mean() * 4.0 * math.pi, rel=3e-3)
    angle = np.arccos(np.clip(found.axis @ directions, -1.0, 1.0))[sent.any(axis=0)]
    assert found.spread + found.reach - 0.003 < angle.max() + 0.01 and angle.max() < found.spread + found.reach
    assert found.box.tolist() == [[*light.position]] * 2


@pytest.mark.parametrize("fov", [152.0, 179.99])
def test_the_power_of_a_wide_projector_is_held(fov):
    """Half extents count up to 4."""
    wide = projector(texture=Checkerboard(RED, RED), fov=fov)
    assert light_bounds(scene(wide))[0].power == pytest.approx(4.0 * 4.0 * 4.0 * 3.0 / 3.0)


@pytest.mark.parametrize("cutoff", [90.0, 120.0, math.nan])
def test_a_spot_light_with_a_texture_is_narrower_than_a_half_space(cutoff):
    with pytest.raises(SceneError, match=f"cutoff .*: {cutoff:g}: must be below 90"):
        replace(CONE, cutoff=cutoff)


# ---- files ---------------------------------------------------------------------------------------------------------------


def test_a_written_scene_is_the_same_again(tmp_path):
    assert engines.load_scene(save_scene(every_light(), tmp_path)).content_hash == every_light().content_hash


def test_texture_and_up_belong_to_the_content():
    plain = replace(CONE, texture=None)
    lights = [plain, CONE, replace(CONE, up=(1.0, 0.0, 0.0)), replace(CONE, texture=quarters())]
    lights += [
        projector(),
        projector(up=(1.0, 0.0, 0.0)),
        projector(texture=high(2)),
        projector(fov=3.0),
        projector(fov_axis="y"),
    ]
    assert len({scene(light).content_hash for light in lights}) == len(lights)
    assert scene(CONE).content_hash == scene(replace(CONE, texture=ImageTexture(CONE.texture.pixels.copy()))).content_hash


def test_a_spot_light_without_texture_keeps_its_hash():
    """That of the version before textures."""
    light = SpotLight((0.0, 3.0, 0.0), (0.0, -1.0, 0.0), (1.0, 2.0, 3.0), 40.0, 30.0)
    camera = Perspective((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), NORTH, 40.0, "y", (8, 8))
    assert content_hash(camera, (), (), (light,)) == "05188499df35287e9a51ce348fad675d3accbf0fa505891131732079ec4f76cd"


@pytest.mark.parametrize("light", [projector(), replace(CONE, beam_width=35.0)], ids=["projector", "spot"])
def test_others_decline_them(light, tmp_path):
    with pytest.raises(Unsupported, match=r"^pbrt's spot lights show no images, and its projectors do without filtering$"):
        export(scene(light), "pbrt", tmp_path)
    for engine in (luxcore.Engine(), cycles.Engine()):
        settings = Settings(64, 64, shader={**PATHS, "max_depth": 4}, sampler=next(iter(engine.takes_samplers)))
        expected = f"lights[0]: {engine.name} does not support the light {type(light).__name__}"
        if type(light) in engine.lights:
            expected = "textures of lights are not translated for Cycles"
        assert engine.why_not(scene(light), settings) == expected


@pytest.mark.parametrize(
    ("texels", "words"), [(QUARTERS[:1], "single row or column"), (-QUARTERS, "negative texels")], ids=["row", "negative"]
)
def test_what_mitsuba_shows_in_another_way_is_not_written_for_it(texels, words, tmp_path):
    with pytest.raises(Unsupported, match=words):
        export(scene(projector(texture=ImageTexture(texels))), "mitsuba", tmp_path / "scene.xml")
