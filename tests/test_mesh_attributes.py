"""Attributes of meshes wherever a texture may stand: the kernels in every precision against the NumPy engine, lamps against
constant ones, and scenes without attributes, whose kernels know nothing of them."""

from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.errors import Unsupported
from engines.kernels.features import FeatureReader
from engines.kernels.flatten.scene import flatten
from engines.kernels.stages import textures
from engines.peers.export import export
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Diffuse,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mesh,
    MeshAttribute,
    Perspective,
    Plastic,
    Principled,
    Scene,
    Sphere,
    Triangle,
)
from tests.adapters import tiny

SIDE = 24
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.2]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
COLOR, FACE, HEAT = MeshAttribute("vertex_color", 0.9), MeshAttribute("face_color"), MeshAttribute("vertex_heat")
CAMERA = Perspective((0.2, -0.4, 7.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 45.0, "y", (SIDE, SIDE))


def square(place, material, names=("vertex_color", "face_color", "vertex_heat"), **keys):
    """Two triangles around a place, with random attributes of these names."""
    random = np.random.default_rng(material)
    shapes = {"vertex_color": (4, 3), "face_color": (2, 3), "vertex_heat": (4, 1)}
    attributes = {name: random.random(shapes[name]) for name in names}
    return Mesh(CORNERS + np.array(place), FACES, np.full(2, material, np.int32), attributes=attributes, **keys)


def attributes_everywhere():
    """Colours, numbers, masks, blends and a lamp, on meshes of which some lack what they do not show; beside other shapes."""
    random = np.random.default_rng(9)
    image = ImageTexture(random.random((4, 4, 3), np.float32))
    height = ImageTexture(random.random((4, 4, 1), np.float32))
    bsdfs = [
        Diffuse(COLOR),
        Mask(HEAT, Blend(MeshAttribute("vertex_color"), Diffuse(FACE), Plastic(image, 1.5, reflectance=COLOR))),
        Bump(height, 0.1, Principled(COLOR, roughness=HEAT, anisotropic=MeshAttribute("face_color", 0.5))),
        Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (MeshAttribute("vertex_color", 0.5), 0.2), FACE),
        Blend(0.5, Diffuse(Checkerboard()), Diffuse((0.5, 0.5, 0.5))),
    ]
    materials = [
        *(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs)),
        Material("lamp", emission=replace(COLOR, scale=9.0)),
    ]
    shapes = [
        Sphere((0.0, 0.0, -2.0), 1.0, 4),
        square((-1.1, 1.1, 0.0), 0, ["vertex_color"]),
        square((1.1, 1.1, 0.0), 1),
        Triangle((-3.0, -3.0, -1.0), (3.0, -3.0, -1.0), (0.0, 3.0, -1.0), 4),
        square((-1.1, -1.1, 0.0), 2, uvs=random.random((4, 2)), normals=np.tile([0.0, 0.0, 1.0], (4, 1))),
        square((1.1, -1.1, 0.0), 3),
        replace(square((2.4, 2.4, 3.0), 5, ["vertex_color"]), faces=FACES[:, ::-1].copy()),
    ]
    return Scene("attributes", CAMERA, tuple(materials), tuple(shapes), (EnvironmentLight((0.3, 0.4, 0.5)),), "")


def rendered(scene, engine, spp=2, precision=None, **shader):
    shader = {"name": "path_tracer", "max_depth": 4, "rr_depth": 3, **shader}
    precision = precision or {"numba": "float64", "embree": "float32"}.get(engine)
    settings = Settings(SIDE, SIDE, seed=5, sampler="sobol", shader=shader, precision=precision, threads=1)
    return engines.engine(engine).prepare(scene, settings).render(spp).mean()


@pytest.mark.parametrize("shader", [{}, {"transparent_shadows": True}], ids=["opaque", "transparent"])
def test_the_kernels_equal_the_numpy_engine(shader):
    reference = rendered(attributes_everywhere(), "numpy", **shader)
    found = rendered(attributes_everywhere(), "numba", **shader)
    assert reference.max() > 0.1 and np.abs(found - reference).max() < 1e-8 * reference.max()


def test_embree_has_the_image_of_the_numpy_engine():
    """But for single paths that rounding sends another way."""
    reference, found = (rendered(attributes_everywhere(), engine, 4) for engine in ("numpy", "embree"))
    assert (np.abs(found - reference).max(axis=2) < 1e-3 * reference.max()).mean() > 0.98


@pytest.mark.parametrize("engine", ["numpy", "embree"])
@pytest.mark.parametrize("direct", ["light", "bsdf"])
def test_an_attribute_that_is_equal_everywhere_is_a_colour(engine, direct):
    white = {"vertex_color": np.ones((4, 3)), "face_color": np.ones((2, 1))}
    scene = attributes_everywhere()
    lamp = replace(square((1.8, 0.0, 3.0), 1, ()), faces=FACES[:, ::-1].copy())

    def lit(reflectance, emission, attributes):
        floor = replace(square((0.0, 0.0, 0.0), 0, ()), attributes=attributes)
        materials = (Material("floor", bsdf=Diffuse(reflectance)), Material("lamp", emission=emission))
        return replace(scene, materials=materials, shapes=(floor, replace(lamp, attributes=attributes)), lights=())

    shown = lit(MeshAttribute("face_color", 0.5), MeshAttribute("vertex_color", 4.0), white)
    images = [rendered(each, engine, direct=direct) for each in (shown, lit((0.5,) * 3, (4.0,) * 3, {}))]
    assert images[0].max() > 0.1 and np.allclose(*images, rtol=0, atol=1e-5)


def test_a_scene_without_attributes_has_kernels_without_them():
    with_some = attributes_everywhere()
    plain = (*(Material(f"m{k}", bsdf=Diffuse(Checkerboard())) for k in range(5)), Material("lamp", emission=(1.0,) * 3))
    features = [flatten(each, np.float32, np.float32).features for each in (with_some, replace(with_some, materials=plain))]
    assert [each.attributes for each in features] == [True, False] and features[1].textures
    reader = FeatureReader(features[1])
    textures.make_color(reader)
    assert reader.read == {"attributes": False}
    assert textures.make_color(features[0]) is not textures.make_color(features[1])
    assert textures.make_color(features[1]) is textures.make_color(features[1]._replace(textures=False))


def test_others_decline_them(tmp_path):
    scene = replace(attributes_everywhere(), lights=(), shapes=(square((0, 0, 0), 0),))
    with pytest.raises(Unsupported, match="material 'm0': pbrt does not support the texture MeshAttribute"):
        export(scene, "pbrt", tmp_path / "s.pbrt")
    settings = Settings(shader={"name": "path_tracer", "rr_depth": 5}, sampler="random")
    assert tiny.Engine().why_not(scene, settings) == "material 'm0': tiny does not support the texture MeshAttribute"


def test_attributes_are_kept_once_for_all_textures_that_show_them():
    scene = attributes_everywhere()
    bsdf = Blend(MeshAttribute("vertex_color"), Diffuse(MeshAttribute("vertex_color", 0.5)), Diffuse(COLOR))
    shown = replace(scene, materials=(Material("m", bsdf=bsdf),), shapes=(square((0, 0, 0), 0),))
    assert flatten(shown, np.float32, np.float32).texture_bytes == 4 * 3 * 4
