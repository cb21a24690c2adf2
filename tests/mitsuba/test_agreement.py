"""Mitsuba and our engines make the same images, at the scale of pixels, tiles and the whole (tests.image_tests).

Replicates are consecutive samples of one render: under independent random numbers these are independent images. All
seeds are fixed; each of the three scales raises a false alarm once in 10,000 scenes.
"""

import numpy as np
import pytest

import engines
from engines import Settings
from harness.config import paths
from tests.image_tests import image_tests
from tests.needs import needs

pytestmark = needs("mitsuba-llvm")

ALPHA = 1e-4
SIDE, REPLICATES, SPP = 24, 16, 8
MANY = {"lattice", "many_lights", "rings", "sphereflake", "tree"}
"""Scenes of hundreds of spheres: Mitsuba records a case for each of them, which takes minutes."""
MEDIA = {"dusty_room": 3, "milk": 24}
"""Scenes with media, which are compared below, and the most segments of their paths there."""
LONG = {"bathroom", "cabinet", "cafe", "classroom", "desk_lamp", "hall", "lantern", "living_room", "still_life", *MEDIA}
"""Furnished scenes, each with kernels of its own that take half a minute to compile; `workshop` is one in the slow tier."""
WITHOUT_COUNTERPART = {
    "cornell_spheres": "refraction without Fresnel's equations",
    "meadow": "the shape Instance",
    "mobilert_cornell": "camera PerspectiveArctan",
    "mobilert_cornell2": "camera PerspectiveArctan",
    "mobilert_spheres2": "camera PerspectiveArctan",
}
FURTHER = {"dahlquist", "gears", "metals", "study", "workshop"}
"""Scenes with kernels of their own that take several seconds; what they are made of is compared one by one below."""
COMPARED = [
    pytest.param(name, marks=[pytest.mark.slow] if name in FURTHER else [])
    for name in sorted(set(paths.shipped("scenes")) - LONG - MANY - set(WITHOUT_COUNTERPART))
]
WAVEFRONT, SCALAR = engines.engine("mitsuba"), engines.engine("mitsuba_scalar")
NUMBA = engines.engine("numba")


def _replicates(engine, scene, shader, seed, spp=SPP):
    """(REPLICATES, SIDE, SIDE, 3) independent images."""
    settings = Settings(SIDE, SIDE, shader=shader, sampler="random", precision=engine_precision(engine), seed=seed, threads=2)
    renderer = engine.prepare(scene, settings)
    sums = [np.zeros((SIDE, SIDE, 3))]
    sums += [renderer.render(spp).sums.copy() for _ in range(REPLICATES)]
    return np.diff(np.stack(sums), axis=0) / spp


def engine_precision(engine):
    """That of Mitsuba and embree; numba in float64 equals numpy on the scenes that are compared with it
    (tests/test_engines_agree.py), and has their code compiled."""
    return "float64" if engine is NUMBA or engine.name == "numpy" else "float32"


def _assert_equivalent(theirs, ours, power=0.1):
    """`power`: the relative bias of the mean that the test must have been able to see."""
    found = image_tests(ours, theirs, ALPHA, margin=0.02)
    assert not found.different, found
    assert found.detectable < power, f"a test that could have seen nothing: {found}"


def _scene(name):
    return engines.load_scene(paths.find("scenes", name))


@pytest.mark.parametrize("name", COMPARED)
def test_the_wavefront_agrees_with_embree_on_shipped_scenes_that_compile_in_seconds(name):
    scene = _scene(name)
    power, spp = (0.5, 4 * SPP) if name == "veach_plates" else (0.1, SPP)  # small lights in mirrors are found by chance alone
    theirs = _replicates(WAVEFRONT, scene, "path_tracer", 1, spp)
    _assert_equivalent(theirs, _replicates(engines.engine("embree"), scene, "path_tracer", 2, spp), power)


@pytest.mark.parametrize(("name", "lacks"), WITHOUT_COUNTERPART.items())
def test_a_shipped_scene_without_counterpart_is_declined_by_what_it_lacks(name, lacks):
    reason = WAVEFRONT.why_not(_scene(name), Settings(SIDE, SIDE, sampler="random"))
    assert reason is not None and lacks in reason


@pytest.mark.parametrize("name", ["cornell_box", "two_spheres", "furnace"])
def test_the_scalar_variant_agrees_with_the_wavefront(name):
    theirs = _replicates(SCALAR, _scene(name), "path_tracer", 3)
    _assert_equivalent(theirs, _replicates(WAVEFRONT, _scene(name), "path_tracer", 1))


@pytest.mark.parametrize("shader", ["whitted", "no_shadows", "depth_map", "albedo"])
@pytest.mark.parametrize("name", ["cornell_box", "two_spheres"])
def test_the_other_shaders_agree_with_numba(name, shader):
    theirs = _replicates(WAVEFRONT, _scene(name), shader, 1)
    _assert_equivalent(theirs, _replicates(NUMBA, _scene(name), shader, 2))


def _panes(material="tinted", **more):
    """A mask, a thin pane and null between lights and a floor; `material`, one of these or `more`, is that of the pane."""
    pattern = np.random.default_rng(1).uniform(0.0, 1.0, (4, 4, 3))
    faces = {"faces": [[0, 1, 2], [0, 2, 3]], "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]]}
    corners = np.array([[-0.6, -0.6, 0], [0.6, -0.6, 0], [0.6, 0.6, 0], [-0.6, 0.6, 0]])
    return {
        "raybench_scene": 1,
        "name": "panes",
        "camera": {"type": "perspective", "eye": [0, -4, 2.2], "target": [0, 0, 0.6], "up": [0, 0, 1], "fov": 45},
        "textures": {"height": {"image": pattern}, "holes": {"image": pattern}},
        "materials": {
            "floor": {"kd": 0.6},
            "cut": {"mask": {"opacity": "holes", "of": {"kd": [0.2, 0.5, 0.1]}}},
            "tinted": {"thin_dielectric": {"specular_transmittance": [0.9, 0.7, 0.5]}},
            "nothing": {"null": {}},
            "lamp": {"emission": [6, 5, 4]},
            **more,
        },
        "shapes": [
            {"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 3}, "material": "floor"},
            {"mesh": {"vertices": np.add(corners, (-0.7, 0, 0.8)), **faces}, "material": "cut"},
            {"mesh": {"vertices": np.add(corners, (0.7, 0, 0.9)), **faces}, "material": material},
            {"sphere": {"center": [0, 0.2, 0.5], "radius": 0.45}, "material": "nothing"},
            {"sphere": {"center": [0, 0.2, 0.5], "radius": 0.2}, "material": "floor"},
            {"disk": {"center": [0, 0, 1.4], "normal": [0, 0, -1], "radius": 0.5}, "material": "lamp"},
        ],
        "lights": [{"point": {"position": [-1, -0.5, 3], "intensity": 3}}, {"environment": {"radiance": [0.2, 0.2, 0.3]}}],
    }


@pytest.mark.parametrize("options", [{"transparent_shadows": True}, {"transparent_shadows": True, "hide_emitters": True}])
def test_surfaces_that_light_passes_and_emitters_that_hide_agree_with_the_reference(options):
    shader = {"name": "path_tracer", "max_depth": 4, "rr_depth": 2, **options}
    scene = engines.scene_from(_panes())
    theirs = _replicates(SCALAR, scene, shader, 1, 3)
    _assert_equivalent(theirs, _replicates(engines.engine("numpy"), scene, shader, 2, 3))


def _media():
    """A coloured ball and a masked pane in fog around the camera, over a floor, under a lamp and the sky. The light of a
    point in fog has a variance without bound."""
    scene = _panes()
    scene["lights"] = scene["lights"][1:]
    scene["camera"] |= {"medium": "fog"}
    scene["media"] = {
        "fog": {"sigma_t": 0.15, "albedo": [0.9, 0.7, 0.5], "g": 0.4},
        "smoke": {"sigma_t": [1.5, 1.7, 2], "albedo": 0.9, "g": -0.4},
    }
    around = {"sphere": {"center": [0, 0, 0], "radius": 6}, "material": "nothing", "interior": "fog"}
    scene["shapes"] = [around, *scene["shapes"]]
    scene["shapes"][4] |= {"interior": "smoke", "exterior": "fog"}
    return engines.scene_from(scene)


@pytest.mark.parametrize("engine", [SCALAR, WAVEFRONT], ids=lambda engine: engine.name)
def test_media_agree_with_the_reference(engine):
    shader = {"name": "volumetric_path_tracer", "max_depth": 5, "rr_depth": 3}
    theirs = _replicates(engine, _media(), shader, 1, 4)
    _assert_equivalent(theirs, _replicates(engines.engine("numpy"), _media(), shader, 2, 4))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "depth"), MEDIA.items())
def test_shipped_scenes_with_media_agree_with_the_reference(name, depth):
    shader = {"name": "volumetric_path_tracer", "max_depth": depth, "rr_depth": 64}
    theirs = _replicates(SCALAR, _scene(name), shader, 1)
    _assert_equivalent(theirs, _replicates(engines.engine("numpy"), _scene(name), shader, 2))


def test_media_that_mitsuba_cannot_sample_are_declined():
    clear = engines.scene_from({**_panes(), "media": {"clear": {"sigma_t": [0, 1, 1], "albedo": 1}}})
    assert "above 0 in every channel" in (SCALAR.why_not(clear, Settings(sampler="random")) or "")


def test_a_bump_around_what_light_passes_is_declined_with_transparent_shadows():
    scene = engines.scene_from(_panes("wavy", wavy={"bump": {"height": "height", "scale": 0.1, "of": "tinted"}}))
    for transparent in (False, True):
        settings = Settings(shader={"name": "path_tracer", "transparent_shadows": transparent}, sampler="random")
        reason = WAVEFRONT.why_not(scene, settings) or ""
        assert ("light samples do not pass" in reason) == transparent, reason


@pytest.mark.parametrize("shader", ["depth_map", "albedo"])
def test_the_scalar_variant_agrees_with_numba(shader):
    theirs = _replicates(SCALAR, _scene("two_spheres"), shader, 1)
    _assert_equivalent(theirs, _replicates(NUMBA, _scene("two_spheres"), shader, 2))


@pytest.mark.parametrize("engine", [WAVEFRONT, SCALAR], ids=lambda engine: engine.name)
def test_scenes_that_are_alive_together_keep_their_colours(engine):
    """Colours above 1 and seen from behind among them."""
    colours = [(0.25, 0.5, 0.75), (6.0, 5.0, 4.0), (0.5, 0.25, 0.125)]
    one, other = (engines.scene_from(_squares(order)) for order in (colours, colours[::-1]))
    settings = Settings(3, 1, shader="albedo", sampler="random", precision="float32", threads=2)
    renderers = [engine.prepare(scene, settings) for scene in (one, other)]
    for renderer, order in zip(renderers, (colours, colours[::-1]), strict=True):
        assert np.allclose(renderer.render(2).mean()[0], order, rtol=1e-6)


def _squares(colours):
    """A pixel of each colour, side by side; those above 1 emit, and the last shows its back."""
    faces = [[0, 1, 2], [0, 2, 3]]
    shapes = [
        {"vertices": [[x - 0.5, -1, 0], [x + 0.5, -1, 0], [x + 0.5, 1, 0], [x - 0.5, 1, 0]], "faces": faces} for x in (-1, 0, 1)
    ]
    shapes[2]["faces"] = [face[::-1] for face in faces]
    return {
        "raybench_scene": 1,
        "name": "three",
        "camera": {"type": "orthographic", "eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "height": 1},
        "materials": {f"m{k}": {"emission" if max(c) > 1 else "kd": list(c)} for k, c in enumerate(colours)},
        "shapes": [{"mesh": shape, "material": f"m{k}"} for k, shape in enumerate(shapes)],
    }


def _everything(**changes):
    """All that Mitsuba has a counterpart for, in one scene."""
    return {
        "raybench_scene": 1,
        "name": "everything",
        "camera": {"type": "orthographic", "eye": [0, 2, 8], "target": [0, 1, 0], "up": [0, 1, 0], "height": 4},
        "materials": {
            "floor": {"kd": [0.6, 0.5, 0.4]},
            "coat": {"kd": [0.3, 0.2, 0.1], "ks": [0.5, 0.6, 0.4]},
            "mirror": {"ks": 0.9},
            "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
            "lamp": {"emission": [6, 5, 4]},
            "glow": {"emission": [1, 2, 3], "two_sided": True, "kd": 0.2},
        },
        "shapes": [
            {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "floor"},
            {"sphere": {"center": [-1.5, 0.7, 0], "radius": 0.7}, "material": "glass"},
            {"sphere": {"center": [0, 0.5, 1], "radius": 0.5}, "material": "mirror"},
            {"sphere": {"center": [1.5, 0.6, 0], "radius": 0.6}, "material": "coat"},
            {"sphere": {"center": [-0.8, 2.4, 0], "radius": 0.2}, "material": "glow"},
            {"procedural": {"name": "sphereflake", "level": 1}, "material": "coat"},
            {"triangle": {"a": [-2, 3.5, -1], "b": [-1, 3.5, 1], "c": [0, 3.5, -1]}, "material": "glow"},
            {
                "procedural": {"name": "box", "half_size": [0.2, 0.2, 0.2], "center": [1.9, 1.9, 0], "rotate_y": 20},
                "material": "lamp",
            },
        ],
        "lights": [
            {"point": {"position": [0, 3, 3], "intensity": [3, 2, 1]}},
            {"directional": {"direction": [1, -2, -1], "irradiance": 0.4}},
            {"environment": {"radiance": [0.2, 0.3, 0.4]}},
        ],
        **changes,
    }


@pytest.mark.parametrize("shader", ["path_tracer", "whitted"])
def test_everything_that_mitsuba_has_agrees_with_numba(shader):
    scene = engines.scene_from(_everything())
    _assert_equivalent(_replicates(WAVEFRONT, scene, shader, 1), _replicates(NUMBA, scene, shader, 2))


def test_an_image_of_the_sky_is_the_same_function(tmp_path):
    """A sky of few and steep texels, seen by itself and in a mirror."""
    from engines.image import write_image

    rows, columns = np.mgrid[0:6, 0:8]
    sky = np.stack([0.1 + rows / 4, 0.2 + columns / 8, 0.3 + 3.0 * ((rows == 2) & (columns == 3))], axis=-1)
    write_image(tmp_path / "sky.exr", sky, {})
    camera = {"type": "perspective", "eye": [0, 1, 5], "target": [0, 1.5, 0], "up": [0, 1, 0], "fov": 100}
    lights = [{"environment": {"image": "sky.exr", "radiance": [1, 0.8, 0.6]}}]
    scene = engines.scene_from(_everything(camera=camera, lights=lights), folder=tmp_path)
    theirs = _replicates(WAVEFRONT, scene, "path_tracer", 1)
    _assert_equivalent(theirs, _replicates(NUMBA, scene, "path_tracer", 2))
