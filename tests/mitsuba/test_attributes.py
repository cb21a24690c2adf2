"""Attributes of meshes are what Mitsuba makes of the same file, and of a scene that is written for it."""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.errors import Unsupported
from engines.peers.export import export
from engines.scene import (
    Blend,
    Conductor,
    Diffuse,
    EnvironmentLight,
    Mask,
    Material,
    Mesh,
    MeshAttribute,
    Perspective,
    Plastic,
    Principled,
    Scene,
)
from engines.scene.formats.ply import parse_ply
from tests.image_tests import image_tests
from tests.mitsuba.peer import mi
from tests.needs import needs
from tests.scene.mitsuba_files import SUN, radiance, written
from tests.scene.test_attributes import NAMES, RED_GREEN_BLUE, named, ply, shape_with

pytestmark = needs("mitsuba-scalar")
PLACES = [(0.25, 0.5), (0.1, 0.1), (0.6, 0.3)]
SIDE, REPLICATES, SPP = 16, 16, 16


@pytest.fixture(autouse=True)
def _scalar():
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)


@pytest.mark.parametrize("properties", NAMES)
def test_the_names_of_a_file_are_mitsubas(properties, tmp_path):
    text = ply(properties, RED_GREEN_BLUE, properties, "1 0 0")
    (tmp_path / "m.ply").write_text(text, encoding="ascii")
    found = parse_ply(text.encode()).attributes
    theirs = mi.traverse(mi.load_dict({"type": "ply", "filename": str(tmp_path / "m.ply")}))
    known = ("vertex_count", "vertex_positions", "vertex_normals", "vertex_texcoords", "face_count")
    names = [key for key, _ in theirs if key.startswith(("vertex_", "face_")) and key not in known]
    assert {*names} == found.keys()
    assert all(np.array_equal(np.ravel(found[name]), np.array(theirs[name])) for name in names)


@pytest.mark.parametrize(
    "texture",
    [named(), named("face_color"), named("vertex_heat"), named(more='<float name="scale" value="0.3"/>')],
    ids=["vertex_color", "face_color", "one number", "scaled"],
)
def test_an_imported_file_has_the_colours_of_mitsubas(texture, tmp_path):
    rows = ("1 .1 .2 .5", ".3 1 0 .25", "0 .4 1 .9")
    text = ply("float r, float g, float b, float heat_0", rows, "float r, float g, float b", ".1 .2 .3")
    (tmp_path / "m.ply").write_text(text, encoding="ascii")
    body = shape_with(texture, more='<boolean name="face_normals" value="true"/>')
    native = mi.load_file(str(written(tmp_path, body, name="native.xml")))
    for x, y in PLACES:
        at = native.ray_intersect(mi.Ray3f([x, y, 5.0], [0.0, 0.0, -1.0]))
        theirs = np.array(at.bsdf().eval_diffuse_reflectance(at))
        assert radiance(tmp_path, body + SUN, (x, y)) == pytest.approx(theirs, abs=1e-4)


def described_scene():
    """Three squares: colours of vertices, of faces and numbers, in colours, roughnesses, masks and blends."""
    random = np.random.default_rng(1)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0.3], [-1, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    attributes = {
        "vertex_color": random.random((4, 3)),
        "face_color": random.random((2, 3)),
        "vertex_heat": random.random((4, 1)),
    }
    color, heat, face = MeshAttribute("vertex_color", 0.9), MeshAttribute("vertex_heat"), MeshAttribute("face_color")
    bsdfs = [
        Blend(color, Diffuse(face), Diffuse(color)),
        Mask(heat, Diffuse(heat)),
        Principled(color, roughness=MeshAttribute("vertex_color", 0.8), metallic=heat),
    ]
    meshes = [
        Mesh(corners + np.array([2.0 * k, 0, 0]), faces, np.full(2, k, np.int32), name=f"m{k}", attributes=attributes)
        for k in range(3)
    ]
    materials = tuple(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs))
    camera = Perspective((2.0, -0.5, 6.0), (2.0, 0.0, 0.0), (0.0, 1.0, 0.0), 40.0, "x", (SIDE, SIDE))
    return Scene("attributes", camera, materials, tuple(meshes), (EnvironmentLight((1.0, 0.8, 0.6)),), "")


def replicates(name, scene, seed):
    precision = None if name == "numba" else "float32"
    shader = {"name": "path_tracer", "max_depth": 2, "rr_depth": 100}
    settings = Settings(SIDE, SIDE, shader=shader, sampler="random", seed=seed, threads=1, precision=precision)
    renderer = engines.engine(name).prepare(scene, settings)
    sums = [np.zeros((SIDE, SIDE, 3)), *(renderer.render(SPP).sums.copy() for _ in range(REPLICATES))]
    return np.diff(np.stack(sums), axis=0) / SPP


def test_mitsuba_renders_the_same_of_a_scene_that_is_described_to_it():
    found = image_tests(
        replicates("numba", described_scene(), 1), replicates("mitsuba_scalar", described_scene(), 2), 1e-4, margin=0.02
    )
    assert not found.different and found.detectable < 0.1, found


def test_an_export_keeps_attributes_and_their_textures(tmp_path):
    again = engines.load_scene(export(described_scene(), "mitsuba", tmp_path / "s.xml"))
    given = described_scene()
    for mesh, before in zip(again.shapes, given.shapes, strict=True):
        shown = {name: values for name, values in mesh.attributes.items() if name in before.attributes}
        assert shown and all(np.array_equal(values, before.attributes[name]) for name, values in shown.items())
    assert again.materials[0].bsdf.weight == MeshAttribute("vertex_color_as_number", 0.9)
    weights = again.shapes[0].attributes["vertex_color_as_number"]
    assert weights[:, 0] == pytest.approx(given.shapes[0].attributes["vertex_color"] @ (0.212671, 0.715160, 0.072169))


def test_what_mitsuba_does_not_take_is_declined(tmp_path):
    base, shown = described_scene(), MeshAttribute("vertex_color")
    for material, words in (
        (Material("m", emission=shown), "'m': Mitsuba has no emission from attributes of meshes"),
        (Material("m", bsdf=Plastic(shown)), "a plastic with a colour from attributes of meshes"),
        (Material("m", bsdf=Diffuse(MeshAttribute("vertex_color", 2.0))), "leave the range"),
        (Material("m", bsdf=Diffuse(shown), emission=(1.0,) * 3, two_sided=True), "of a surface that emits on both"),
    ):
        held = Scene("s", base.camera, (material,) * 3, base.shapes, (), "")
        with pytest.raises(Unsupported, match=words):
            export(held, "mitsuba", tmp_path / "s.xml")


def test_the_albedo_of_a_metal_with_an_attribute_is_declined():
    base = described_scene()
    metal = Material("m", bsdf=Conductor((0.2,) * 3, (3.0,) * 3, reflectance=MeshAttribute("vertex_color")))
    held = Scene("s", base.camera, (metal,) * 3, base.shapes, (), "")
    why = engines.engine("mitsuba_scalar").why_not(held, engines.Settings(shader="albedo", sampler="random"))
    assert why is not None and "Mitsuba's albedo has no metal with an attribute" in why
