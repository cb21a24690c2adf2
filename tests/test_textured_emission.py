"""Surfaces that emit what a texture holds: a floor under a lamp of four colours, by quadrature; and every shape that can be
such a lamp, in the kernels against the NumPy engine."""

from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, save_scene
from engines.errors import Unsupported
from engines.image import write_image
from engines.peers.export import export
from engines.scene import (
    Checkerboard,
    Cylinder,
    Diffuse,
    Disk,
    ImageTexture,
    Material,
    Mesh,
    Perspective,
    Plane,
    Scene,
    Sphere,
    Triangle,
)
from engines.scene.content import content_hash

QUARTERS = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [4, 4, 4]]], np.float32)
SPOT = (0.3, 0.2)
ABOVE = Perspective((*SPOT, 1.0), (*SPOT, 0.0), (0.0, 1.0, 0.0), 0.01, "y", (16, 16))
GREY = Material("grey", bsdf=Diffuse((0.5, 0.5, 0.5)))
PATHS = {"name": "path_tracer", "max_depth": 2, "rr_depth": 100}
SQUARE = np.array([[-1.0, 1.0, 2.0], [1.0, 1.0, 2.0], [1.0, -1.0, 2.0], [-1.0, -1.0, 2.0]])
"""Faces downwards: the normal of (0, 1, 2) is -z."""


def lamp(texture, uvs=((0, 0), (1, 0), (1, 1), (0, 1)), camera=ABOVE):
    """A square of 2 m, 2 m above a grey floor."""
    square = Mesh(SQUARE, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones(2, np.int32), uvs=np.array(uvs, float))
    floor = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0)
    return Scene("lamp", camera, (GREY, Material("lamp", emission=texture)), (floor, square), (), "")


def quarters(**keys):
    return ImageTexture(QUARTERS, "nearest", **keys)


def expected():
    """(3,) radiance of the floor at SPOT: 0.5/pi times the integral of L cos cos / r^2 over the lamp, by midpoints."""
    n = 400
    x = -1 + (np.arange(n) + 0.5) * 2 / n
    dx, dy = np.meshgrid(x - SPOT[0], x - SPOT[1])
    share = 4.0 / (dx**2 + dy**2 + 4.0) ** 2 * (2 / n) ** 2
    u, v = np.meshgrid((x + 1) / 2, (1 - x) / 2)
    return np.tensordot(share, QUARTERS[(v * 2).astype(int), (u * 2).astype(int)], 2) * 0.5 / np.pi


def content_of(scene):
    return content_hash(scene.camera, scene.materials, scene.shapes, scene.lights)


def rendered(scene, engine, precision, spp=64, **shader):
    settings = Settings(shader=PATHS | shader, precision=precision, sampler="sobol", seed=3)
    return engines.engine(engine).prepare(scene, settings).render(spp).mean()


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
@pytest.mark.parametrize(
    ("engine", "precision"), [("numpy", "float64"), ("embreex_batch", "float64"), ("numba", "float64"), ("embree", "float32")]
)
def test_a_floor_is_lit_by_the_texture_of_the_lamp(engine, precision, direct):
    """256 pixels of the same place. Sobol's error is below that of random samples: 4 % at most where light is hit by chance."""
    pixels = rendered(lamp(quarters()), engine, precision, direct=direct).reshape(-1, 3)
    error = pixels.std(axis=0) / np.sqrt(len(pixels))
    assert np.abs(pixels.mean(axis=0) - expected()).max() < 4.5 * error.max() < 0.01


def test_coordinates_outside_of_0_1_repeat():
    moved = [(u + 3, v - 2) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
    assert np.allclose(rendered(lamp(quarters(), moved), "numpy", None, 4), rendered(lamp(quarters()), "numpy", None, 4))


def test_the_camera_sees_the_texture():
    below = Perspective((0.0, 0.0, 1.0), (0.0, 0.0, 2.0), (0.0, 1.0, 0.0), 89.0, "y", (2, 2))
    for engine in ("numpy", "numba"):
        seen = rendered(lamp(quarters(), camera=below), engine, "float64", 1)
        assert np.allclose(seen, QUARTERS[:, ::-1])  # looking up, right is -x


def every_lamp():
    """Each kind of shape with a texture of its own, some with both sides; a plane is in no list of lights."""
    rng = np.random.default_rng(4)

    def image(**keys):
        return ImageTexture(rng.uniform(0, 6, (3, 4, 3)).astype(np.float32), **keys)

    materials = [
        GREY,
        Material("a", emission=image(), two_sided=True),
        Material("b", emission=quarters(wrap="mirror")),
        Material("c", emission=image(to_uv=(0.8, -0.6, 0.17, 0.6, 0.8, -0.31))),
        Material("d", emission=image()),
        Material("e", emission=Checkerboard((5.0, 1.0, 0.0), (0.0, 2.0, 5.0), (3.0, 0.0, 0.1, 0.0, 3.0, 0.2)), two_sided=True),
        Material("f", emission=ImageTexture(np.full((1, 1, 1), 0.2, np.float32)), bsdf=GREY.bsdf),
    ]
    uvs = np.array([[0.1, 0.0], [1.9, 0.2], [1.7, 1.6], [-0.2, 1.3]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    shapes = [
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0),
        Plane((0.0, 4.0, 0.0), (0.0, -1.0, 0.0), 6),
        Mesh(SQUARE * 0.5 + (-1.5, 0.5, 0.5), faces, np.array([1, 0], np.int32), uvs=uvs),
        Triangle((1.0, 1.0, 2.0), (2.0, 1.5, 2.0), (1.5, 0.5, 1.2), 5),
        Sphere((0.2, 0.3, 1.0), 0.4, 2),
        Disk((1.2, -0.3, 0.9), (0.48, -0.36, -0.8), 0.5, 3),
        Cylinder((-0.6, -0.8, 0.5), (-0.2, -0.9, 1.1), 0.2, 4),
    ]
    camera = Perspective((0.3, -4.0, 1.9), (0.0, 0.0, 0.7), (0.0, 0.0, 1.0), 60.0, "y", (24, 24))
    return Scene("lamps", camera, tuple(materials), tuple(shapes), (), "")


@pytest.mark.parametrize(
    "shader",
    [
        {"light_sampler": "uniform"},
        {"light_sampler": "bvh", "light_candidates": 4},
        {"light_sampler": "power", "direct": "light"},
    ],
    ids=["uniform", "bvh, candidates", "power"],
)
def test_the_kernels_equal_the_numpy_engine_on_every_kind_of_lamp(shader):
    images = [rendered(every_lamp(), engine, "float64", 2, max_depth=3, **shader) for engine in ("numpy", "numba")]
    reference, found = images
    assert reference.max() > 1 and np.abs(found - reference).max() < 1e-8 * reference.max()


def test_lamps_found_by_chance_and_sampled_are_as_bright():
    images = [rendered(every_lamp(), "numba", "float64", 256, direct=direct) for direct in ("light", "bsdf")]
    light, bsdf = (image.mean(axis=(0, 1)) for image in images)
    assert np.abs(light / bsdf - 1).max() < 0.01


def test_a_written_scene_is_the_same_again(tmp_path):
    scene = every_lamp()
    assert engines.load_scene(save_scene(scene, tmp_path)).content_hash == content_of(scene)


def test_texture_coordinates_of_a_lamp_belong_to_its_content():
    assert content_of(lamp(quarters())) != content_of(lamp(quarters(), ((0, 0), (1, 0), (1, 1), (0, 0.5))))


AREA = """<scene version="3.0.0"><integrator type="path"/>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
    <float name="fov" value="0.01"/>
    <transform name="to_world"><lookat origin="0.3,0.2,1" target="0.3,0.2,0" up="0,1,0"/></transform></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="10"/></transform><bsdf type="diffuse"/></shape>
  {outside}
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate z="2"/></transform>
    <emitter type="area">{inside}</emitter></shape></scene>"""
BITMAP = """<texture type="bitmap" {name}><string name="filename" value="quarters.exr"/><boolean name="raw" value="true"/>
    <string name="filter_type" value="nearest"/></texture>"""
PLACES = {
    "by reference": AREA.format(outside=BITMAP.format(name='id="t"'), inside='<ref name="radiance" id="t"/>'),
    "inside": AREA.format(outside="", inside=BITMAP.format(name='name="radiance"')),
}


@pytest.mark.parametrize("place", PLACES)
def test_an_area_emitter_of_mitsuba_keeps_its_texture(place, tmp_path):
    write_image(tmp_path / "quarters.exr", QUARTERS)
    (tmp_path / "room.xml").write_text(PLACES[place])
    pixels = rendered(engines.load_scene(tmp_path / "room.xml"), "numpy", "float64").reshape(-1, 3)
    error = pixels.std(axis=0) / np.sqrt(len(pixels))
    assert np.abs(pixels.mean(axis=0) - expected()).max() < 4.5 * error.max() < 0.006


def test_an_export_to_mitsuba_keeps_the_texture(tmp_path):
    again = engines.load_scene(export(lamp(quarters()), "mitsuba", tmp_path / "lamp.xml"))
    found = next(material.emission for material in again.materials if material.emits)
    assert isinstance(found, ImageTexture) and found.filter == "nearest" and np.array_equal(found.pixels, QUARTERS)


TURNED = (0.0, 1.0, 0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("form", "scene", "words"),
    [
        ("mitsuba", lamp(quarters(), ((0, 0), (2, 0), (2, 1), (0, 1))), r"'lamp': Mitsuba has emission .* in \[0, 1\]"),
        ("mitsuba", lamp(quarters(to_uv=TURNED)), "'lamp': Mitsuba has emission from a texture .* without to_uv"),
        ("mitsuba", every_lamp(), "Mitsuba has emission from a texture on one side of meshes alone"),
        ("pbrt", lamp(quarters()), "'lamp': pbrt does not support emission from textures"),
    ],
    ids=["repeated", "turned", "shapes", "pbrt"],
)
def test_what_others_sample_in_another_way_is_declined(form, scene, words, tmp_path):
    with pytest.raises(Unsupported, match=words):
        export(scene, form, tmp_path)


@pytest.mark.parametrize("engine", ["luxcore", "cycles"])
def test_peers_decline_it(engine):
    only = lamp(quarters())
    settings = Settings(shader={**PATHS, "max_depth": 4}, sampler={"luxcore": "random", "cycles": "sobol"}[engine])
    declined = engines.engine(engine).why_not(replace(only, shapes=only.shapes[1:]), settings)
    assert declined == f"material 'lamp': {engine} takes no emission from a texture"
