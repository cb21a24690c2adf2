"""Mitsuba files that are refused: in one line that says where, what was found and what is expected, and quickly."""

import re

import pytest

import engines
from engines.scene.mitsuba_xml import bsdfs, emitters, sensors, shapes, textures
from tests.scene.mitsuba_files import LAMP, SENSOR, refusal, scene, written

BALL = '<shape type="sphere">{}</shape>'


def shape_with(xml):
    return BALL.format(xml) + LAMP


WRONG = {
    "unknown shape": ('<shape type="teapot"/>', ["s.xml:2", "teapot", "unknown shape", "sphere"]),
    "phong": (shape_with('<bsdf type="phong"/>'), ["s.xml:2", "phong", "roughplastic"]),
    "unknown bsdf": (shape_with('<bsdf type="difuse"/>'), ["difuse", "did you mean 'diffuse'"]),
    "nested phong": (shape_with('<bsdf type="twosided">\n<bsdf type="phong"/></bsdf>'), ["s.xml:3", "phong"]),
    "glass inside twosided": (shape_with('<bsdf type="twosided"><bsdf type="dielectric"/></bsdf>'), ["twosided", "leave"]),
    "mask inside twosided": (
        shape_with('<bsdf type="twosided"><bsdf type="mask"><bsdf type="diffuse"/></bsdf></bsdf>'),
        ["twosided"],
    ),
    "two bsdfs": (shape_with('<bsdf type="diffuse"/><bsdf type="diffuse"/>'), ["sphere", "BSDF"]),
    "unknown metal": (
        shape_with('<bsdf type="conductor"><string name="material" value="Na"/></bsdf>'),
        ["material", "Au", "eta and k"],
    ),
    "metal twice": (
        shape_with('<bsdf type="conductor"><string name="material" value="Au"/><rgb name="eta" value="1"/></bsdf>'),
        ["either"],
    ),
    "bright reflectance": (
        shape_with('<bsdf type="diffuse"><rgb name="reflectance" value="1.5"/></bsdf>'),
        ["reflectance", "[0, 1]"],
    ),
    "negative colour": (shape_with('<bsdf type="diffuse"><rgb name="reflectance" value="-1"/></bsdf>'), ["negative"]),
    "not a colour": (shape_with('<bsdf type="diffuse"><rgb name="reflectance" value="red"/></bsdf>'), ["red", "numbers"]),
    "not finite": (shape_with('<bsdf type="diffuse"><float name="reflectance" value="nan"/></bsdf>'), ["nan", "finite"]),
    "blackbody": (shape_with('<bsdf type="diffuse"><blackbody name="reflectance" temperature="1"/></bsdf>'), ["colour"]),
    "no weight": (
        shape_with('<bsdf type="blendbsdf"><bsdf type="diffuse"/><bsdf type="diffuse"/></bsdf>'),
        ["weight", "missing"],
    ),
    "one child of a blend": (
        shape_with('<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"/></bsdf>'),
        ["2 nested"],
    ),
    "distribution": (
        shape_with('<bsdf type="roughconductor"><string name="distribution" value="phong"/></bsdf>'),
        ["beckmann or ggx"],
    ),
    "unknown texture": (
        shape_with('<bsdf type="diffuse"><texture type="noise" name="reflectance"/></bsdf>'),
        ["noise", "bitmap"],
    ),
    "mesh attribute": (
        shape_with('<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance"/></bsdf>'),
        ["name: must begin with vertex_ or face_"],
    ),
    "checkerboard as height": (
        shape_with('<bsdf type="bumpmap"><texture type="checkerboard"/><bsdf type="diffuse"/></bsdf>'),
        ["image"],
    ),
    "wraps": (
        shape_with(
            '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="no.png"/>'
            "</texture></bsdf>"
        ),
        ["no.png", "no such file"],
    ),
    "medium": (shape_with('<medium name="interior" type="heterogeneous"/>'), ["media", "homogeneous"]),
    "medium by reference": (
        '<medium id="fog" type="heterogeneous"/>' + shape_with('<ref name="interior" id="fog"/>'),
        ["media"],
    ),
    "subsurface": (shape_with('<subsurface type="dipole"/>'), ["below the surface"]),
    "instance": ('<shape type="instance"/>', ["a shapegroup"]),
    "two environments": (LAMP + '<emitter type="constant"/>\n<emitter type="constant"/>', ["s.xml:3", "second environment"]),
    "unknown emitter": ('<emitter type="glow"/>', ["glow", "envmap"]),
    "environment that is stretched": (
        '<emitter type="sunsky"><transform name="to_world"><scale x="2"/></transform></emitter>',
        ["rotation"],
    ),
    "spot light with a colour as texture": (
        '<emitter type="spot"><texture type="uniform" name="texture"><rgb name="color" value="1"/></texture></emitter>',
        ["texture", "image or a checkerboard"],
    ),
    "wide spot light with a texture": (
        '<emitter type="spot"><float name="cutoff_angle" value="90"/><texture type="checkerboard" name="texture"/></emitter>',
        ["cutoff_angle", "below 90"],
    ),
    "projector that is stretched": (
        '<emitter type="projector"><transform name="to_world"><scale x="2"/></transform></emitter>',
        ["stretch"],
    ),
    "projector with an attribute": (
        '<emitter type="projector"><texture type="mesh_attribute" name="irradiance">'
        '<string name="name" value="face_color"/></texture></emitter>',
        ["projector", "image or a checkerboard"],
    ),
    "projector without an angle": ('<emitter type="projector"><float name="fov" value="180"/></emitter>', ["fov", "(0, 180)"]),
    "unknown id": (shape_with('<ref id="none"/>'), ["none", "no such id"]),
    "id twice": ('<bsdf id="a" type="diffuse"/>\n<bsdf id="a" type="diffuse"/>', ["s.xml:3", "s.xml:2"]),
    "property twice": (shape_with('<float name="radius" value="1"/><float name="radius" value="2"/>'), ["twice", "line 2"]),
    "refers to itself": (
        '<bsdf id="a" type="mask"><ref id="b"/></bsdf><bsdf id="b" type="mask"><ref id="a"/></bsdf>'
        + shape_with('<ref id="a"/>'),
        ["itself"],
    ),
    "no size": (shape_with('<float name="radius" value="0"/>'), ["radius", "greater than 0"]),
    "flat emitter": (
        '<shape type="rectangle"><transform name="to_world"><scale x="0"/></transform><emitter type="area"/></shape>',
        ["no area"],
    ),
    "huge transform": (
        '<shape type="cube"><transform name="to_world"><scale value="1e30"/><scale value="1e30"/></transform></shape>',
        ["range"],
    ),
    "unknown step": ('<shape type="cube"><transform name="to_world"><shear x="1"/></transform></shape>', ["shear", "rotate"]),
    "matrix": ('<shape type="cube"><transform name="to_world"><matrix value="1 2"/></transform></shape>', ["9 or 16"]),
    "projection": (
        '<shape type="cube"><transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1"/></transform></shape>',
        ["last row"],
    ),
    "axis": ('<shape type="cube"><transform name="to_world"><rotate angle="3"/></transform></shape>', ["axis"]),
    "animation": ('<shape type="cube"><animation name="to_world"/></shape>', ["motion"]),
    "unknown element": ("<shap/>", ["shap", "did you mean 'shape'"]),
    "no type": ("<shape/>", ["'type' is missing"]),
    "no value": (shape_with('<float name="radius"/>'), ["'value' is missing"]),
    "no parameter": (shape_with('<float name="radius" value="$r"/>'), ["$r", "no value"]),
    "useless child": (shape_with('<bsdf type="diffuse"><bsdf type="diffuse"/></bsdf>'), ["no use for bsdf"]),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_has_no_counterpart_or_is_wrong_is_refused_with_its_line(tmp_path, name):
    body, said = WRONG[name]
    message = refusal(tmp_path, body)
    for words in ["s.xml", *said]:
        assert words in message, message


SENSORS = {
    "none": ("", "no sensor"),
    "unknown": ('<sensor type="fisheye"/>', "perspective"),
    "crop": (
        SENSOR.replace('value="8"/>', 'value="8"/><integer name="crop_offset_x" value="1"/>'),
        "crop_offset_x + crop_width = 9: must be at most width, 8",
    ),
    "empty crop": (SENSOR.replace('value="8"/>', 'value="8"/><integer name="crop_width" value="0"/>'), "[1, 8]"),
    "spectral film": ('<sensor type="perspective"><film type="specfilm"/></sensor>', "use hdrfilm"),
    "shifted": (
        '<sensor type="perspective"><float name="principal_point_offset_x" value="1e6"/></sensor>',
        "misses the image by more than 65,536 of its sides",
    ),
    "scaled": (
        '<sensor type="perspective"><transform name="to_world"><scale value="2"/></transform></sensor>',
        "must not scale",
    ),
    "sheared": (
        '<sensor type="orthographic"><transform name="to_world"><matrix value="1 1 0 0 1 0 0 0 1"/></transform></sensor>',
        "shear",
    ),
    "flat": ('<sensor type="orthographic"><transform name="to_world"><scale x="0"/></transform></sensor>', "flatten"),
    "huge film": (SENSOR.replace('value="8"', 'value="10000000"'), "65536"),
    "fov": (SENSOR.replace('value="40"', 'value="190"'), "(0, 180)"),
    "thinlens": ('<sensor type="thinlens"/>', "aperture_radius"),
    "clip": (SENSOR.replace("<film", '<float name="near_clip" value="9"/><float name="far_clip" value="8"/><film'), "less"),
}


@pytest.mark.parametrize("name", SENSORS)
def test_sensors_that_are_refused(tmp_path, name):
    sensor, said = SENSORS[name]
    assert said in refusal(tmp_path, shape_with(""), sensor=sensor)


MALFORMED = {
    "not XML": "raybench_scene: 1",
    "cut short": '<scene version="3.0.0"><shape',
    "another root": "<svg/>",
    "version": '<scene version="new"/>',
    "binary": "\x00\x01",
    "entities": '<!DOCTYPE scene [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><scene version="3.0.0">&b;</scene>',
    "external": '<!DOCTYPE scene SYSTEM "file:///etc/hostname"><scene/>',
    "unknown entity": "<scene>&a;</scene>",
    "deep": "<scene>" + '<bsdf type="mask">' * 100_000,
    "many": "<scene>" + '<bsdf type="null"/>' * 500_000,
    "encoding": '<?xml version="1.0" encoding="klingon"?><scene/>',
    "empty": "",
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_files_are_refused_in_a_line(tmp_path, name):
    file = tmp_path / "s.xml"
    file.write_text(MALFORMED[name], encoding="utf-8")
    with pytest.raises(engines.SceneError) as caught:
        engines.load_scene(file)
    message = str(caught.value)
    assert "s.xml" in message and "\n" not in message and len(message) < 1000


@pytest.mark.parametrize(
    ("kind", "plugins"), [("shape", shapes), ("bsdf", bsdfs), ("emitter", emitters), ("sensor", sensors), ("texture", textures)]
)
def test_plugins_that_are_refused_have_something_in_their_place(kind, plugins, tmp_path):
    for name, why in plugins.REFUSED.items():
        assert re.search(r": (use|leave|bake|export|put) ", f": {why}"), name
        if kind in ("shape", "emitter"):
            message = refusal(tmp_path, f'<{kind} type="{name}"/>{LAMP}')
            assert message.startswith(f'{tmp_path / "s.xml"}:2 <{kind} type="{name}">: ') and message.endswith(why)


@pytest.mark.parametrize(
    ("xml", "said"),
    [
        ('<texture type="volume" name="reflectance"><volume type="gridvolume" name="volume"/></texture>', "use constvolume"),
        ('<texture type="volume" name="reflectance"><volume type="constvolume"/></texture>', "of the name 'volume'"),
        (
            '<texture type="volume" name="reflectance"><volume type="constvolume" name="volume">'
            '<texture type="checkerboard" name="value"/></volume></texture>',
            "a colour is expected",
        ),
    ],
)
def test_volumes_that_vary_are_refused(xml, said, tmp_path):
    assert said in refusal(tmp_path, shape_with(f'<bsdf type="diffuse">{xml}</bsdf>'))


def test_parameters_do_not_grow_without_bound(tmp_path):
    body = '<default name="a0" value="aaaaaaaaaa"/>'
    body += "".join(f'<default name="a{i}" value="{f"$a{i - 1}" * 10}"/>' for i in range(1, 20))
    assert "MiB of text" in refusal(tmp_path, body)


def test_references_do_not_multiply_without_bound(tmp_path):
    body = '<bsdf id="b0" type="diffuse"/>'
    for i in range(1, 30):
        twice = f'<ref id="b{i - 1}"/><ref id="b{i - 1}"/>'
        body += f'<bsdf id="b{i}" type="blendbsdf"><float name="weight" value="0.5"/>{twice}</bsdf>'
    assert "BSDFs within each other" in refusal(tmp_path, body + shape_with('<ref id="b29"/>'))
    chain = '<bsdf id="b0" type="diffuse"/>'
    chain += "".join(f'<bsdf id="b{i}" type="mask"><ref id="b{i - 1}"/></bsdf>' for i in range(1, 5000))
    assert "within each other" in refusal(tmp_path, chain + shape_with('<ref id="b4999"/>'))


def test_included_files_stay_inside_and_end(tmp_path):
    inside = tmp_path / "scene"
    inside.mkdir()
    written(tmp_path, LAMP, name="out.xml", sensor="")
    assert "allow" in refusal(inside, '<include filename="../out.xml"/>')
    assert "lies outside" in refusal(inside, '<include filename="/etc/hostname"/>')
    assert scene(inside, '<include filename="../out.xml"/><shape type="sphere"/>', allow_outside=True).lights
    assert "includes itself" in refusal(inside, '<include filename="s.xml"/>')
    written(inside, '<include filename="b.xml"/>', name="a.xml", sensor="")
    written(inside, '<include filename="a.xml"/>', name="b.xml", sensor="")
    message = refusal(inside, '<include filename="a.xml"/>')
    assert "includes itself" in message and "b.xml:2" in message


def test_files_stay_in_the_folder_links_followed(tmp_path):
    inside = tmp_path / "scene"
    inside.mkdir()
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="ascii")
    (inside / "link.obj").symlink_to(tmp_path / "m.obj")
    body = '<shape type="obj"><string name="filename" value="{}"/></shape>' + LAMP
    for name in ("../m.obj", "link.obj"):
        assert "lies outside" in refusal(inside, body.format(name))
    assert "no such file" in refusal(inside, body.format("none.obj"))
    assert "missing" in refusal(inside, f'<shape type="obj"/>{LAMP}')


def test_unused_parameters_are_refused(tmp_path):
    assert "no parameter $radius" in refusal(tmp_path, shape_with(""), parameters={"radius": "1"})
    with pytest.raises(engines.SceneError, match="Mitsuba"):
        engines.load_scene("cornell_box", parameters={"a": "1"})
