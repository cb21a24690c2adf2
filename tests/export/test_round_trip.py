"""Exported constructs: Mitsuba renders our image of the file, and raybench reads its own file as the scene it was."""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.peers.export import export
from harness.config import paths
from tests.mitsuba.peer import mi
from tests.needs import needs

SIDE = 12
TEXTURE = np.random.default_rng(5).random((6, 6, 3)).astype(np.float32)
TILTS = TEXTURE / 4 + [0.4, 0.4, 0.7]
CAMERA = {"type": "perspective", "eye": [0.6, 0.9, 3.5], "target": [0, 0, 0], "fov": 40, "resolution": [SIDE, SIDE]}
SQUARE = {
    "mesh": {
        "vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
        "faces": [[0, 1, 2], [0, 2, 3]],
        "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]],
    }
}
BALL = {"sphere": {"center": [0.2, 0, 0], "radius": 0.8}}
IMAGE = {"image": TEXTURE, "color_space": "raw", "filter": "nearest"}
RED = {"diffuse": {"reflectance": [0.7, 0.3, 0.2]}}
SKY = {"environment": {"radiance": [0.5, 0.6, 0.7]}}
TINTED = {"environment": {"image": TEXTURE[:3] + 0.2, "rotation": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]}}


def of(material, shape=SQUARE, **more):
    """A scene of one shape."""
    return {
        "raybench_scene": 1,
        "camera": CAMERA,
        "lights": [SKY],
        "materials": {"m": material, "red": RED},
        "shapes": [{**shape, "material": "m"}],
        **more,
    }


def textured(**placing):
    return of({"diffuse": {"reflectance": "t"}}, textures={"t": IMAGE | placing})


def seen(shape=SQUARE, **more):
    return of(RED, shape, **more)


def through(**camera):
    return seen(BALL, camera={**CAMERA, **camera})


def lit_by(light):
    return seen(textures={"t": IMAGE | {"filter": "bilinear", "to_uv": [[1.2, 0.5, 0.1], [-0.4, 0.9, 0.7]]}}, lights=[light])


FLAT = {"type": "orthographic", "height": 2.5}
FLAT_CAMERA = {key: value for key, value in CAMERA.items() if key != "fov"} | FLAT
SMOOTH = SQUARE | {"mesh": {**SQUARE["mesh"], "vertices": [[-1, -1, 0], [1, -1, 0.5], [1, 1, 0], [-1, 1, 0.5]], "smooth": True}}
FOG, SMOKE = {"sigma_t": 0.1, "albedo": 0.7, "g": -0.3}, {"sigma_t": [0.8, 1, 1.3], "albedo": [0.9, 0.5, 0.7], "g": 0.6}
CLEAR, MEDIA = {"null": {}}, {"fog": FOG, "smoke": SMOKE}
AROUND = {"sphere": {"center": [0, 0, 0], "radius": 6}, "material": "m", "interior": "fog"}


def before(shape):
    """Fog in front of a shape that is seen from there, and vacuum behind."""
    return of(CLEAR, shape, camera=FLAT_CAMERA, media=MEDIA) | {"shapes": [{**shape, "material": "m", "exterior": "fog"}]}


SCENES = {
    "medium": of(CLEAR, {**BALL, "interior": "smoke"}, media=MEDIA),
    "media around each other": of(CLEAR, camera={**CAMERA, "medium": "fog", "clip": [0.5, 100]}, media=MEDIA)
    | {"shapes": [AROUND, {**BALL, "material": "m", "interior": "smoke", "exterior": "fog"}]},
    "fog before a mesh": before(SQUARE),
    "fog before a disk": before({"disk": {"center": [0, 0, 0], "normal": [1, 2, 3], "radius": 0.9}}),
    "fog before a plane": before({"plane": {"point": [0, -0.5, 0], "normal": [0.2, 1, 0.1]}}),
    "fog before a cylinder": before({"cylinder": {"p0": [-1, 0, 0], "p1": [0.8, 0.5, 0], "radius": 0.4}}),
    "offset": textured(offset=[0.3, 0.6]),
    "scale and offset": textured(scale=[2, 3], offset=[0.3, 0.6], wrap="mirror"),
    "matrix": textured(to_uv=[[1.2, 0.5, 0.1], [-0.4, 0.9, 0.7]], wrap="clamp"),
    "checkerboard": of(
        {"diffuse": {"reflectance": "t"}},
        textures={"t": {"checkerboard": {"a": [0.9, 0.2, 0.1], "b": 0.1}, "scale": [2, 3], "offset": [0.15, 0.4]}},
    ),
    "one number": of({"mask": {"opacity": "t", "of": "red"}}, textures={"t": IMAGE | {"channel": "g", "offset": [0.2, 0.1]}}),
    "smooth mesh": seen(SMOOTH),
    "disk": seen({"disk": {"center": [0, 0, 0], "normal": [1, 2, 3], "radius": 0.9}}),
    "cylinder": seen({"cylinder": {"p0": [-1, 0, 0], "p1": [0.8, 0.5, 0], "radius": 0.4}}),
    "triangle": seen({"triangle": {"a": [-1, -1, 0], "b": [1, -1, 0], "c": [0, 1, 0.5]}}),
    "plane": seen({"plane": {"point": [0, -0.5, 0], "normal": [0.2, 1, 0.1]}}),
    "spheres": seen({"spheres": {"centers": [[-0.5, 0, 0], [0.5, 0, 0]], "radii": [0.4, 0.6]}}),
    "lamp": of({"kd": 0, "emission": [2, 1, 0.5]}, BALL),
    "lamp of two sides": of({"kd": 0.2, "emission": 1, "two_sided": True}, SQUARE),
    "conductor": of({"conductor": {"metal": "Au", "alpha": [0.2, 0.4]}}, SQUARE),
    "dielectric": of({"dielectric": {"ior": 1.4}}, BALL),
    "thin dielectric": of({"thin_dielectric": {"ior": 1.4}}),
    "plastic": of({"plastic": {"diffuse": [0.6, 0.3, 0.2], "ior": 1.4, "alpha": 0.2}}, BALL),
    "principled": of({"principled": {"base_color": [0.6, 0.3, 0.2], "roughness": 0.4, "metallic": 0.3}}, BALL),
    "blend": of({"blend": {"weight": 0.3, "a": "red", "b": {"conductor": {"metal": "Cu", "alpha": 0.4}}}}, BALL),
    "sides": of({"by_side": {"front": "red", "back": {"diffuse": {"reflectance": 0.2}}}}),
    "normal map": of({"normal_map": {"map": "t", "of": "red"}}, textures={"t": {**IMAGE, "image": TILTS}}),
    "sky": seen(BALL, lights=[TINTED]),
    "point": seen(lights=[{"point": {"position": [0.5, 1, 2], "intensity": [3, 2, 1]}}]),
    "sun": seen(lights=[{"directional": {"direction": [1, -1, -2], "irradiance": 2}}]),
    "spot": seen(lights=[{"spot": {"position": [0, 1, 2], "target": [0, 0, 0], "intensity": 4, "cutoff": 40}}]),
    "spot with a texture": lit_by(
        {"spot": {"position": [0.1, 0.2, 2], "target": [0, 0, 0], "intensity": 4, "cutoff": 20, "texture": "t"}}
    ),
    "projector": lit_by(
        {"projector": {"position": [0.1, 0.2, 2], "target": [0, 0, 0], "irradiance": [4, 5, 6], "fov": 40, "texture": "t"}}
    ),
    "mirrored camera": through(mirror=True, fov_axis="x"),
    "shifted camera": through(principal_point=[0.1, -0.2]),
    "clipped camera": through(clip=[3.1, 3.6]),
    "thin lens": through(type="thin_lens", aperture_radius=0.1, focus_distance=2),
    "orthographic": seen(camera=FLAT_CAMERA),
    "wide window": seen(camera={**FLAT_CAMERA, "width": 6, "principal_point": [0.1, 0.05]}),
}
RENEWED = {"lamp of two sides", "furnace", "sky"}
"""What comes back as something else of the same look, so that its samples are others: a surface that emits on both sides
is two, a hair apart, and a sky has rows between its own. The means of their images differ by less than 1 %, by chance."""


def rendered(scene, spp):
    shader = {"name": "volumetric_path_tracer" if scene.media else "path_tracer", "max_depth": 3, "rr_depth": 100}
    settings = Settings(SIDE, SIDE, shader=shader, sampler="sobol", seed=3)
    return engines.engine("numpy").prepare(scene, settings).render(spp).sums / spp


@pytest.mark.parametrize("what", [*SCENES, "cornell_box", "two_spheres", "mobilert_spheres", "veach_plates", "furnace"])
def test_raybench_reads_its_own_export_as_the_same_scene(what, tmp_path):
    """The same samples give the same image, but for float32 in files."""
    scene = engines.scene_from(SCENES[what]) if what in SCENES else engines.load_scene(paths.find("scenes", what))
    read = engines.load_scene(export(scene, "mitsuba", tmp_path / "scene.xml", max_depth=3))
    assert not [warning for warning in read.warnings if not warning.startswith(("dropped", "black from behind"))]
    if what in RENEWED:
        assert rendered(read, 64).mean(axis=(0, 1)) == pytest.approx(rendered(scene, 64).mean(axis=(0, 1)), rel=0.01)
    else:
        assert rendered(read, 4) == pytest.approx(rendered(scene, 4), abs=1e-4)


@needs("mitsuba-scalar")
@pytest.mark.parametrize("what", SCENES)
def test_mitsuba_renders_what_is_exported_to_our_image(what, tmp_path):
    """Pixels differ by at most 1.5 % of the mean on average, by chance; by more than 11 % where an offset of texture
    coordinates is lost."""
    scene = engines.scene_from(SCENES[what])
    mi.set_variant("scalar_rgb")
    loaded = mi.load_file(str(export(scene, "mitsuba", tmp_path / "scene.xml", max_depth=3)))
    theirs, ours = np.array(mi.render(loaded, spp=256, seed=1))[..., :3], rendered(scene, 64)
    assert np.abs(theirs - ours).mean() <= 0.05 * ours.mean()
