"""`raybench convert` from every kind of file to every kind: what it writes is rendered, and is the source's image."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import engines
from engines import Settings
from engines.errors import ConfigError, Unsupported
from harness.cli import app
from tests.export import pbrt_file
from tests.gltf_file import GltfFile
from tests.image_tests import image_tests
from tests.needs import needs

SIDE, SPP, REPLICATES, DEPTH = 12, 16, 8, 4
OBJ = """
mtllib m.mtl
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v 0 1.2 0
usemtl red
f 1 2 5
f 2 3 5
usemtl tiles
f 3 4 5
f 4 1 5
"""
MTL = "newmtl red\nKd .8 .2 .1\nnewmtl tiles\nKd 0.5 0.5 0.5\n"
YAML = """
raybench_scene: 1
camera: {type: perspective, eye: [0.3, 1.5, 4], target: [0, 0.5, 0], fov: 40, resolution: [12, 12]}
media: {smoke: {sigma_t: [3, 4, 5], albedo: 0.9, g: 0.4}}
textures: {tiles: {image: tiles.png, scale: 2, offset: [0.25, 0.5]}}
materials: {"1e-5": {diffuse: {reflectance: tiles}}, clear: {"null": {}}, grey: {kd: 0.5}}
shapes:
  - mesh:
      vertices: [[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2]]
      faces: [[0, 2, 1], [0, 3, 2]]
      uvs: [[0, 0], [1, 0], [1, 1], [0, 1]]
    material: "1e-5"
  - {mesh: {file: m.obj}, material: grey}
  - {sphere: {center: [0.5, 0.8, 1.2], radius: 0.5}, material: clear, interior: smoke}
lights: [{environment: {radiance: [0.5, 0.6, 0.7]}}, {point: {position: [2, 3, 2], intensity: 6}}]
"""
XML = """<scene version="3.0.0">
<integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0.3,1.5,4" target="0,0.5,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/><rfilter type="box"/></film></sensor>
<emitter type="constant"><rgb name="radiance" value="0.5,0.6,0.7"/></emitter>
<medium type="homogeneous" id="smoke"><rgb name="sigma_t" value="3,4,5"/><float name="albedo" value="0.9"/></medium>
<shape type="obj"><string name="filename" value="m.obj"/><boolean name="face_normals" value="true"/>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.3,0.2"/></bsdf></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
<string name="filename" value="tiles.png"/></texture></bsdf></bsdf></shape>
<shape type="sphere"><point name="center" x="0.5" y="0.8" z="1.2"/><float name="radius" value="0.5"/>
<bsdf type="null"/><ref name="interior" id="smoke"/></shape>
<shape type="disk"><transform name="to_world"><translate x="-0.8" y="1.5" z="0.3"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
<emitter type="area"><rgb name="radiance" value="2,1,0.5"/></emitter></shape>
</scene>"""


def _gltf():
    file = GltfFile()
    file.material(
        pbrMetallicRoughness={
            "baseColorTexture": file.image([[[200, 90, 40], [30, 200, 90]], [[90, 30, 200], [220, 220, 220]]]),
            "roughnessFactor": 0.6,
            "metallicFactor": 0.2,
        }
    )
    return file


def _ply(folder):
    vertices, faces = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [0, 1.2, 0]], float), [[0, 1, 3], [1, 2, 3]]
    lines = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {axis}" for axis in "xyz"), "element face 2"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, row)) for row in vertices.tolist()] + [" ".join(map(str, (3, *face))) for face in faces]
    (folder / "m.ply").write_text("\n".join(lines) + "\n")


SOURCES = ("room.yaml", "room.xml", "m.glb", "m.gltf", "m.obj", "m.ply")


@pytest.fixture
def folder(tmp_path):
    """A folder with every source, and what they read."""
    source = tmp_path / "source"
    source.mkdir()
    texels = np.random.default_rng(2).integers(30, 220, (4, 4, 3), np.uint8)
    Image.fromarray(texels).save(source / "tiles.png")
    for name, text in (("room.yaml", YAML), ("room.xml", XML), ("m.obj", OBJ), ("m.mtl", MTL), ("m.gltf", _gltf().gltf())):
        (source / name).write_text(text)
    (source / "m.glb").write_bytes(_gltf().glb())
    _ply(source)
    return tmp_path


def converted(folder, source, output, *options):
    """The path that the command has written, which its last line tells."""
    target = folder / output
    options = options or ("--max-depth", str(DEPTH))
    done = CliRunner().invoke(app, ["convert", str(folder / "source" / source), "-o", str(target), *options])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    written = target / "scene.yaml" if target.is_dir() else target
    assert str(written) in done.output
    return written


def films(scene, engine, count=1, spp=SPP, sampler="random"):
    """(count, SIDE, SIDE, 3) means of independent samples."""
    shader = {"name": "volumetric_path_tracer" if scene.media else "path_tracer", "max_depth": DEPTH, "rr_depth": 1000}
    renderer = engines.engine(engine).prepare(scene, Settings(SIDE, SIDE, shader=shader, sampler=sampler, seed=3))
    sums = [np.zeros((SIDE, SIDE, 3)), *(renderer.render(spp).sums.copy() for _ in range(count))]
    return np.diff(sums, axis=0) / spp


@pytest.mark.parametrize("name", SOURCES)
def test_the_raybench_scene_gives_the_same_numbers_as_the_source(name, folder):
    source, written = (engines.load_scene(path) for path in (folder / "source" / name, converted(folder, name, "out")))
    ours, theirs = films(source, "numpy", spp=2, sampler="sobol"), films(written, "numpy", spp=2, sampler="sobol")
    assert np.array_equal(ours, theirs) and ours.std() > 0
    assert written.content_hash == source.content_hash
    assert {material.name for material in written.materials} == {material.name for material in source.materials}


@pytest.mark.parametrize("name", SOURCES)
def test_the_mitsuba_file_reads_as_the_source(name, folder):
    """The same samples, but for float32 in files."""
    source, written = (engines.load_scene(path) for path in (folder / "source" / name, converted(folder, name, "out.xml")))
    assert written.shader["name"] == ("volumetric_path_tracer" if source.media else "path_tracer")
    ours, theirs = films(source, "numpy", spp=2, sampler="sobol"), films(written, "numpy", spp=2, sampler="sobol")
    assert theirs == pytest.approx(ours, abs=2e-4)


@pytest.mark.parametrize(("name", "depth", "rr_depth"), [("room.xml", 4, 5), ("room.yaml", 16, 5)])
def test_depths_are_those_of_the_source_or_else_the_defaults(name, depth, rr_depth, folder):
    shader = engines.load_scene(converted(folder, name, "out.xml", "--spp", "1")).shader
    assert (shader["max_depth"], shader["rr_depth"]) == (depth, rr_depth)


@pytest.mark.parametrize("name", SOURCES)
@needs("mitsuba-scalar")
def test_mitsuba_renders_the_file_that_is_written_for_it_to_the_source_s_image(name, folder):
    written = engines.load_scene(converted(folder, name, "out.xml"), natively=True)
    assert written.native is not None, "Mitsuba reads the file itself"
    theirs = films(written, "mitsuba_scalar", REPLICATES)
    ours = films(engines.load_scene(folder / "source" / name), "numpy", REPLICATES)
    found = image_tests(ours, theirs, 1e-4, margin=0.01)
    assert not found.different, found
    assert found.detectable < 0.06


@pytest.mark.parametrize("name", ["room.yaml", "room.xml", "m.obj", "m.ply"])
def test_the_pbrt_file_is_complete(name, folder):
    scene = engines.load_scene(folder / "source" / name)
    text = pbrt_file.check(converted(folder, name, "out.pbrt"))
    words = [word for word, _ in pbrt_file.directives(text)]
    assert words.count("MakeNamedMedium") == len(scene.media)
    assert words.count("MakeNamedMaterial") == len(scene.materials)
    assert words.count("LightSource") == len(scene.lights)
    assert f'Integrator "{"volpath" if scene.media else "path"}" "integer maxdepth" [ {DEPTH - 1} ]' in text


@pytest.mark.parametrize("name", ["m.glb", "m.gltf"])
def test_what_pbrt_lacks_is_refused_in_one_line_and_nothing_is_written(name, folder):
    with pytest.raises(Unsupported, match="pbrt does not support the BSDF Principled") as caught:
        converted(folder, name, "out.pbrt")
    assert "\n" not in str(caught.value)
    assert sorted(path.name for path in folder.iterdir()) == ["source"]


PROJECTOR = {"projector": {"position": [0, 1, 3], "target": [0, 0, 0], "irradiance": 3, "texture": "tiles"}}
LEFT = {"lights": [PROJECTOR]}, {"camera": {"type": "perspective", "eye": [0, 1, 4], "target": [0, 0, 0], "mirror": True}}


@pytest.mark.parametrize(("changes", "said"), [(LEFT[0], "projectors do without filtering"), (LEFT[1], "mirrored")])
def test_projectors_and_mirrored_cameras_are_written_for_mitsuba_and_refused_for_pbrt(changes, said, folder):
    scene = {"raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 1, 4], "target": [0, 0, 0]}}
    scene |= {"materials": {"m": {"kd": 0.5}}, "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "m"}]}
    scene |= {"textures": {"tiles": {"image": "tiles.png"}}, "lights": [{"environment": {"radiance": 1}}], **changes}
    (folder / "source" / "s.yaml").write_text(json.dumps(scene))
    source, written = (engines.load_scene(path) for path in (folder / "source/s.yaml", converted(folder, "s.yaml", "out.xml")))
    assert films(written, "numpy", spp=2) == pytest.approx(films(source, "numpy", spp=2), abs=2e-4)
    with pytest.raises(Unsupported, match=said):
        converted(folder, "s.yaml", "out.pbrt")


@pytest.mark.parametrize("output", ["out", "out.xml"])
def test_what_the_reader_has_approximated_is_said_whatever_is_written(output, folder):
    file = _gltf()
    file.tree["materials"][0]["extensions"] = {"KHR_materials_iridescence": {"iridescenceFactor": 1}}
    file.tree["extensionsUsed"] = ["KHR_materials_iridescence"]
    (folder / "source" / "m.gltf").write_text(file.gltf())
    done = CliRunner().invoke(app, ["convert", str(folder / "source" / "m.gltf"), "-o", str(folder / output)])
    assert "KHR_materials_iridescence" in done.output


def test_other_suffixes_are_refused(folder):
    with pytest.raises(ConfigError, match=r"ends in \.xml or \.pbrt is expected"):
        converted(folder, "m.obj", "out.txt")
