"""Mitsuba's own files as they are: what Mitsuba is given of them, who declines them, and integrators that race on one."""

import os
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import SceneError, Settings
from engines.image import read_provenance
from engines.peers.mitsuba import ScalarEngine
from engines.peers.mitsuba.streams import seed_of
from harness.analysis import analyse
from harness.analysis.model import ranked_together
from harness.store.results import load_results
from tests import forked
from tests.harness import sweeping
from tests.mitsuba.peer import mi
from tests.needs import needs

pytestmark = needs("mitsuba-scalar")

FOG = """\
<scene version="3.0.0">
  <default name="side" value="12"/>
  <integrator type="path"/>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 1, 6" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="$side"/><integer name="height" value="8"/><rfilter type="{filter}"/>
    </film>
    <sampler type="{sampler}"/>
  </sensor>
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.7 0.8 0.9"/><rgb name="albedo" value="0.9"/><phase type="rayleigh"/>
  </medium>
  <shape type="sphere">
    <point name="center" x="0" y="0.8" z="0"/><float name="radius" value="0.8"/>
    <bsdf type="null"/><ref name="interior" id="fog"/>
  </shape>
  <shape type="ply">
    <string name="filename" value="{floor}"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf>
  </shape>
  <emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter>
</scene>
"""
FLOOR = """\
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
-9 0 9
9 0 9
0 0 -9
3 0 1 2
"""
VOLPATH = {"name": "mitsuba", "type": "volpath", "max_depth": 6}


def fog(folder, floor="floor.ply", text=FOG, **changes):
    folder.mkdir(exist_ok=True)
    (folder / "floor.ply").write_text(FLOOR)
    file = folder / "fog.xml"
    file.write_text(text.format(**{"floor": floor, "filter": "gaussian", "sampler": "multijitter", **changes}))
    return file


def test_a_file_that_cannot_be_imported_is_for_mitsuba_alone(tmp_path):
    file = fog(tmp_path)
    with pytest.raises(SceneError, match=r"fog\.xml:1[0-6]"):
        engines.load_scene(file)
    scene = engines.load_scene(file, natively=True)
    assert scene.camera.resolution == (12, 8)
    for name in ("numba", "numpy", "embree"):
        assert "fog.xml:1" in str(engines.engine(name).why_not(scene, Settings(sampler="random")))
    settings = Settings(sampler="random")
    assert ScalarEngine().why_not(scene, settings) is None
    assert "not with the shader albedo" in str(ScalarEngine().why_not(scene, Settings(sampler="random", shader="albedo")))
    with pytest.raises(engines.ConfigError, match="nosuch"):
        ScalarEngine().why_not(scene, Settings(sampler="random", shader={"name": "mitsuba", "type": "nosuch"}))


def test_render_takes_a_sampler_that_the_engine_has_and_names_the_engine_for_the_file(tmp_path):
    words = ["render", str(fog(tmp_path)), "--spp", "1", "-o", str(tmp_path / "fog.exr")]
    assert forked.raybench([*words, "--engine", "mitsuba_scalar"], None, os.environ).returncode == 0
    assert read_provenance(tmp_path / "fog.exr")["settings"]["sampler"] == {"name": "random"}
    refused = forked.raybench([*words, "--engine", "numpy"], None, os.environ)
    assert refused.returncode == 2
    assert "The engine mitsuba is given the file as it is" in refused.stderr.replace("\n", " ")
    fog(tmp_path, text=FOG.replace('<float name="fov"', '<float name="wrong" value="1"/><float name="fov"'))
    declined = forked.raybench([*words, "--engine", "mitsuba_scalar"], None, os.environ)
    assert declined.returncode == 2 and "does not load" in declined.stderr and "has no sampler" not in declined.stderr


def test_the_image_is_the_one_that_mitsuba_renders_of_the_file(tmp_path):
    """Of the same seed, with a box filter and independent samples, which the file itself does not have."""
    scene = engines.load_scene(fog(tmp_path), natively=True)
    film = ScalarEngine().prepare(scene, Settings(24, 10, shader=VOLPATH, sampler="random", seed=5)).render(1)
    mi.set_variant("scalar_rgb")
    (tmp_path / "own").mkdir()
    own = fog(tmp_path / "own", filter="box", sampler="independent")
    own.write_text(own.read_text().replace('name="height" value="8"', 'name="height" value="10"'))
    integrator = mi.load_dict({"type": "volpath", "max_depth": 6, "block_size": 16})
    loaded = mi.load_file(str(own), side="24")
    theirs = np.array(mi.render(loaded, integrator=integrator, seed=seed_of(5, 0), spp=1))[..., :3]
    assert film.sums.max() > 0.0 and np.allclose(film.sums, theirs, rtol=1e-5)


def test_a_crop_has_the_size_that_it_has_in_the_file_alone(tmp_path):
    crop = {"crop_offset_x": 2, "crop_width": 7, "crop_offset_y": 3, "crop_height": 5}
    sides = "".join(f'<integer name="{name}" value="{side}"/>' for name, side in crop.items())
    file = fog(tmp_path, text=FOG.replace("<rfilter", f"{sides}<rfilter"), filter="box", sampler="independent")
    scene = engines.load_scene(file, natively=True)
    assert scene.camera.resolution == (7, 5)
    film = ScalarEngine().prepare(scene, Settings(shader=VOLPATH, sampler="random", seed=5)).render(1)
    mi.set_variant("scalar_rgb")
    integrator = mi.load_dict({"type": "volpath", "max_depth": 6, "block_size": 16})
    theirs = np.array(mi.render(mi.load_file(str(file)), integrator=integrator, seed=seed_of(5, 0), spp=1))[..., :3]
    assert theirs.shape == (5, 7, 3) and film.sums.max() > 0.0 and np.allclose(film.sums, theirs, rtol=1e-5)
    assert "7 x 5 pixels only" in str(ScalarEngine().why_not(scene, Settings(14, 10, sampler="random")))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"floor": "../outside.ply"}, "outside"),
        ({"floor": "nosuch.ply"}, "no such file"),
        ({"filter": "box", "text": FOG.replace('bsdf type="diffuse"', 'bsdf type="../evil"')}, "plugin"),
        ({"text": FOG.replace('<float name="fov"', '<string name="odd" value="/etc/passwd"/><float name="fov"')}, "path"),
        ({"text": FOG.replace("<rfilter", '<integer name="crop_width" value="14"/><rfilter')}, "crop"),
        ({"text": FOG.replace("<scene", "<!DOCTYPE x [<!ENTITY a 'b'>]><scene")}, "document type"),
    ],
)
def test_what_mitsuba_must_not_be_given_is_refused(changes, words, tmp_path):
    (tmp_path / "outside.ply").write_text(FLOOR)
    with pytest.raises(SceneError, match=words):
        engines.load_scene(fog(tmp_path / "scene", **changes), natively=True)


def test_a_file_that_mitsuba_does_not_load_is_declined_in_its_words(tmp_path):
    text = FOG.replace('<float name="fov"', '<float name="wrong" value="1"/><float name="fov"')
    reason = ScalarEngine().why_not(engines.load_scene(fog(tmp_path, text=text), natively=True), Settings(sampler="random"))
    assert reason is not None and "does not load" in reason and "wrong" in reason and "\n" not in reason


def test_aliases_whole_crops_and_meshes_that_mitsuba_cannot_merge_load(tmp_path):
    """A floor that is turned over shares its BSDF with one that is not: Mitsuba's loader fails where it would merge them."""
    floor = '<shape type="ply"><string name="filename" value="floor.ply"/><ref id="g"/>{{}}</shape>'
    more = f'<bsdf type="null" id="m"/><alias id="m" as="g"/>{floor}{floor}'
    text = FOG.replace("</scene>", more.replace("{{}}", '<boolean name="flip_normals" value="true"/>', 1).replace("{{}}", ""))
    text = text.replace("<rfilter", '<integer name="cropOffsetX" value="0"/><rfilter') + "</scene>"
    held = engines.load_scene(fog(tmp_path, text=text), natively=True)
    assert ScalarEngine().why_not(held, Settings(sampler="random")) is None


def test_another_file_beside_is_another_scene(tmp_path):
    first = engines.load_scene(fog(tmp_path), natively=True).identity
    assert engines.load_scene(fog(tmp_path), natively=True).identity == first
    file = fog(tmp_path)
    file.write_text(file.read_text().replace("<medium", "<!-- remarks do not count --><medium"))
    assert engines.load_scene(file, natively=True).identity == first
    (tmp_path / "floor.ply").write_text(FLOOR.replace("-9 0 9", "-8 0 9"))
    assert engines.load_scene(file, natively=True).identity != first


RACE = """\
raybench_experiment: 1
scene: fog.xml
resolution: [12, 8]
engine: mitsuba_scalar
sampler: random
matrix: {shader: [{name: path_tracer, max_depth: 6}, {name: mitsuba, type: volpath, max_depth: 6}]}
budget: {max_time: 5s, max_spp: 8, timeout: 60s}
checkpoints: {ratio: 2, start: 1}
repeats: 2
reference: {engine: mitsuba_scalar, spp: 64, sampler: random, shader: {name: mitsuba, type: volpath, max_depth: 6}}
quality: {targets: [1.0, 0.1]}
images: none
remeasure: 0
"""


def test_two_integrators_race_towards_one_reference(tmp_path):
    fog(tmp_path)
    path = sweeping.write(tmp_path, RACE, "race.yaml")
    sweeping.run(path, tmp_path / "out")
    results = load_results(tmp_path / "out")
    assert len(results.references) == 1
    assert [str(contestant.settings.shader) for contestant in results.contestants if len(contestant.done) == 2] == [
        "mitsuba(max_depth=6, type=volpath)",
        "path_tracer(direct=mis, max_depth=6, rr_depth=5)",
    ]
    (race,) = ranked_together(analyse(results).verdicts).values()
    assert len(race) == 2


PLAIN = """\
<scene version="3.0.0">
  <default name="r" value="0.25"/><default name="r" value="0.75"/><include filename="sub/wall.xml"/>
  <sensor type="orthographic">
    <transform name="to_world"><lookat origin="0, 0, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="2"/><integer name="height" value="2"/></film>
  </sensor>
  <emitter type="directional"><vector name="direction" value="0 0 -1"/>
    <rgb name="irradiance" value="3.141592653589793"/></emitter>
</scene>
"""
WALL = """<scene version="3.0.0"><include filename="wall_mesh.xml"/><default name="r" value="0.5"/></scene>"""
MESH = """<shape version="3.0.0" type="ply"><string name="filename" value="floor.ply"/>
<bsdf type="diffuse"><rgb name="reflectance" value="$r"/></bsdf></shape>"""
UPRIGHT = FLOOR.replace("-9 0 9", "-9 -9 0").replace("9 0 9", "9 -9 0").replace("0 0 -9", "0 9 0")


def plain(folder):
    (folder / "sub").mkdir()
    (folder / "floor.ply").write_text(UPRIGHT)
    (folder / "sub/wall.xml").write_text(WALL)
    (folder / "sub/wall_mesh.xml").write_text(MESH)
    (folder / "plain.xml").write_text(PLAIN)
    return folder / "plain.xml"


@pytest.mark.parametrize(("parameters", "albedo"), [({}, 0.25), ({"r": "0.6"}, 0.6)])
def test_mitsuba_reads_the_file_itself_and_finds_what_raybench_finds(parameters, albedo, tmp_path):
    scene = engines.load_scene(plain(tmp_path), parameters=parameters)
    for engine in (ScalarEngine(), engines.engine("numpy")):
        film = engine.prepare(scene, Settings(2, 2, shader="path_tracer", sampler="random")).render(1)
        assert film.sums == pytest.approx(albedo, rel=1e-5)


def test_what_raybench_misreads_is_declined_instead_of_rendered(tmp_path):
    """Mitsuba is given no words of raybench's, and no file that raybench has not looked up."""
    scene = engines.load_scene(plain(tmp_path))
    for name, files in (("named", [tmp_path / "other.ply"]), ("xml", [tmp_path / "plain.xml"])):
        wrong = replace(scene, native=replace(scene.native, **{name: frozenset(files), "digest": name}))
        said = str(ScalarEngine().why_not(wrong, Settings(sampler="random")))
        assert "none of the files that raybench has found" in said
    named = engines.load_scene(plain_with(tmp_path, "$filename"), parameters={"filename": "0.5"})
    assert "Mitsuba takes no parameter $filename" in str(ScalarEngine().why_not(named, Settings(sampler="random")))


def plain_with(folder, name):
    file = folder / "named.xml"
    file.write_text(PLAIN.replace('value="0.25"', f'value="{name}"'))
    return file


def test_every_word_of_an_xml_file_is_in_its_digest(tmp_path):
    """Also a `default` that does not count for raybench, and one in an included file."""
    file = plain(tmp_path)
    first = engines.load_scene(file).identity
    assert engines.load_scene(file, parameters={"r": "0.25"}).identity != first
    for changed, old, new in (("plain.xml", "0.75", "0.8"), ("sub/wall.xml", "0.5", "0.4")):
        text = (tmp_path / changed).read_text()
        (tmp_path / changed).write_text(text.replace(old, new))
        assert engines.load_scene(file).identity != first
        (tmp_path / changed).write_text(text)
    assert engines.load_scene(file).identity == first
