"""What becomes of a Mitsuba file besides its plugins: parameters, includes, aliases, notes, transforms."""

import math

import numpy as np
import pytest

import engines
from engines.image import write_image
from tests.scene.mitsuba_files import LAMP, SENSOR, refusal, scene, shape, written


def test_the_integrator_suggests_a_shader(tmp_path):
    def shader(xml):
        return scene(tmp_path, f'<shape type="sphere"/>{LAMP}{xml}').shader

    path = '<integrator type="path"><integer name="max_depth" value="{}"/><integer name="rr_depth" value="3"/></integrator>'
    assert shader(path.format(7)) == {"name": "path_tracer", "max_depth": 7, "rr_depth": 3}
    assert shader(path.format(-1)) == {"name": "path_tracer", "max_depth": 100_000, "rr_depth": 3}
    assert shader('<integrator type="direct"/>') == {"name": "path_tracer", "max_depth": 2}
    assert shader("") is None
    hidden = '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>'
    assert shader(hidden) == {"name": "path_tracer", "hide_emitters": True, "max_depth": 100_000, "rr_depth": 5}


@pytest.mark.parametrize(
    ("bsdf", "transparent", "noted"),
    [
        ('<bsdf type="diffuse"/>', False, False),
        ('<bsdf type="null"/>', True, False),
        ('<bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="diffuse"/></bsdf>', True, False),
        (
            '<bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="h.png"/></texture>'
            '<bsdf type="thindielectric"/></bsdf>',
            True,
            True,
        ),
    ],
)
def test_volpath_suggests_transparent_shadows_where_there_are_null_lobes(tmp_path, bsdf, transparent, noted):
    """Its roulette begins one vertex later than that of `path`."""
    write_image(tmp_path / "h.png", np.full((2, 2, 3), 0.5), {})
    integrator = '<integrator type="volpath"><integer name="rr_depth" value="3"/></integrator>'
    found = scene(tmp_path, f'{integrator}<shape type="sphere">{bsdf}</shape>{LAMP}')
    options = {"transparent_shadows": True} if transparent else {}
    assert found.shader == {"name": "path_tracer", "max_depth": 100_000, "rr_depth": 4, **options}
    assert any("light samples pass" in warning for warning in found.warnings) == noted


def test_parameters_have_defaults_and_the_callers_win(tmp_path):
    body = '<default name="r" value="0.5"/><default name="rr" value="$r"/>'
    body += f'<shape type="sphere"><float name="radius" value="$rr"/></shape>{LAMP}'
    assert scene(tmp_path, body).shapes[0].radius == 0.5
    assert scene(tmp_path, body, parameters={"r": "2"}).shapes[0].radius == 2.0


def test_included_files_stand_in_their_place(tmp_path):
    (tmp_path / "more.xml").write_text('<scene version="3.0.0"><bsdf type="conductor" id="m"/></scene>', encoding="utf-8")
    found = scene(tmp_path, f'<include filename="more.xml"/><shape type="sphere"><ref id="m"/></shape>{LAMP}')
    assert found.materials[0].name == "m"


def test_an_alias_is_another_id_and_files_are_looked_for_in_paths_first(tmp_path):
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "m.xml").write_text('<scene version="3.0.0"><bsdf type="conductor" id="m"/></scene>', encoding="utf-8")
    body = '<path value="more"/><include filename="m.xml"/><alias id="m" as="n"/><shape type="sphere"><ref id="n"/></shape>'
    assert scene(tmp_path, body).materials[0].name == "m"
    assert "before this line" in refusal(tmp_path, '<alias id="m" as="n"/>')
    assert "is taken" in refusal(tmp_path, '<bsdf type="null" id="m"/><alias id="m" as="m"/>')
    (tmp_path / "o.xml").touch()
    assert "outside" in refusal(tmp_path / "more", '<path value=".."/><include filename="o.xml"/>')


def test_what_does_not_change_the_image_is_dropped_and_said_once(tmp_path):
    body = f'<shape type="sphere"><bsdf type="roughdiffuse"><string name="oddity" value="1"/></bsdf></shape>{LAMP}'
    sensor = SENSOR.replace("</film>", '<rfilter type="tent"/></film><sampler type="ldsampler"/>')
    warnings = scene(tmp_path, body, sensor=sensor + SENSOR).warnings
    assert sum("ldsampler" in warning for warning in warnings) == 1
    for said in (
        "tent",
        "oddity of bsdf roughdiffuse is not read",
        "roughdiffuse is taken as diffuse",
        "of 2 sensors the first",
    ):
        assert any(said in warning for warning in warnings), said
    assert any(warning.startswith("black from behind") and "roughdiffuse" in warning for warning in warnings)


def test_elements_of_the_wild_are_left_out(tmp_path):
    body = f'<mode type="final"/><hide type="x"><float name="y" value="z"/></hide><shape type="sphere"/>{LAMP}'
    assert len(scene(tmp_path, body, "0.5.0").shapes) == 1


def test_an_unused_texture_may_be_missing(tmp_path):
    body = '<texture type="bitmap" id="t"><string name="filename" value="nosuch.png"/></texture>'
    found = scene(tmp_path, f'{body}<shape type="sphere"/>{LAMP}')
    assert found.native is None and "nosuch.png" in found.warnings[-1] and "not the file" in found.warnings[-1]


def test_transforms_apply_one_after_the_other(tmp_path):
    steps = '<scale value="2"/><rotate z="1" angle="90"/><matrix value="1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1"/>'
    steps += '<matrix value="0 1 0 1 0 0 0 0 1"/>'
    xml = f'<shape type="sphere"><point name="center" value="1 0 0"/><transform name="toWorld">{steps}</transform></shape>'
    found = shape(tmp_path, xml, "0.5.0")
    assert found.center == pytest.approx((2.0, 5.0, 0.0)) and found.radius == pytest.approx(2.0)
    assert not engines.load_scene(written(tmp_path, xml, "0.5.0")).lights


def reflectance(folder, body, **options):
    """Red of the diffuse BSDF of the one shape, whose reflectance is `$r`."""
    shape = '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="$r"/></bsdf></shape>'
    return scene(folder, f"{body}{shape}{LAMP}", **options).materials[0].bsdf.front.reflectance[0]


def test_the_first_default_of_a_name_wins_with_includes_in_their_place(tmp_path):
    """As in Mitsuba 3.9.1; `default` elements count from where they stand."""
    (tmp_path / "i.xml").write_text('<scene version="3.0.0"><default name="r" value="0.7"/></scene>', encoding="ascii")
    first, second, include = (
        '<default name="r" value="0.1"/>',
        '<default name="r" value="0.2"/>',
        '<include filename="i.xml"/>',
    )
    assert reflectance(tmp_path, first + second) == 0.1
    assert reflectance(tmp_path, first + include) == 0.1
    assert reflectance(tmp_path, include + first) == 0.7
    assert reflectance(tmp_path, first + second, parameters={"r": "0.3"}) == 0.3
    assert "has no value" in refusal(tmp_path, '<shape type="$r"/><default name="r" value="sphere"/>')


def test_a_dollar_after_a_backslash_is_a_dollar(tmp_path):
    (tmp_path / "$r.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="ascii")
    body = '<default name="r" value="x"/><shape type="obj"><string name="filename" value="\\$r.obj"/></shape>'
    assert len(scene(tmp_path, body + LAMP).shapes[0].faces) == 1
    assert "parameter $ has no value" in refusal(tmp_path, body.replace("\\$r", "$"))


def nested(folder, text="", **files):
    """A folder with `sub/i.xml`, which holds `text`, and other files; returns the element that includes it."""
    for name, content in {"sub/i.xml": f'<scene version="3.0.0">{text}</scene>', **files}.items():
        file = folder / name
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_text(content, encoding="ascii")
    return '<include filename="sub/i.xml"/>'


LEAF = '<scene version="3.0.0"><shape type="sphere"><float name="radius" value="{}"/></shape></scene>'


def radii(folder, body):
    return [found.radius for found in scene(folder, body + LAMP).shapes]


def test_an_include_is_looked_for_beside_the_file_then_in_its_paths_then_beside_the_main_file(tmp_path):
    include = nested(tmp_path, '<include filename="leaf.xml"/>', **{"sub/leaf.xml": LEAF.format(2), "leaf.xml": LEAF.format(3)})
    assert radii(tmp_path, include) == [2.0]
    (tmp_path / "sub/leaf.xml").unlink()
    assert radii(tmp_path, include) == [3.0]
    nested(tmp_path, '<path value="more"/><include filename="leaf.xml"/>', **{"sub/more/leaf.xml": LEAF.format(4)})
    assert radii(tmp_path, include) == [4.0]


def test_the_root_of_an_include_may_be_a_plugin(tmp_path):
    light = '<emitter version="3.0.0" type="constant"><rgb name="radiance" value="9"/></emitter>'
    include = nested(tmp_path, **{"sub/i.xml": light})
    assert scene(tmp_path, f'<shape type="sphere"/>{include}').lights[0].radiance == (9.0, 9.0, 9.0)
    texture = '<texture version="3.0.0" type="uniform" name="no"><float name="value" value="0.25"/></texture>'
    nested(tmp_path, **{"sub/i.xml": texture})
    body = f'<shape type="sphere"><bsdf type="diffuse">{include.replace("/>", " name=")}"reflectance"/></bsdf></shape>{LAMP}'
    assert scene(tmp_path, body).materials[0].bsdf.front.reflectance == (0.25, 0.25, 0.25)
    nested(tmp_path, **{"sub/i.xml": '<float name="radius" value="2"/>'})
    assert "the root of an included file is <scene>, or a plugin" in refusal(tmp_path, include)


def test_other_files_are_looked_for_from_the_main_file_alone(tmp_path):
    mesh = '<shape type="obj"><string name="filename" value="m.obj"/></shape>'
    include = nested(tmp_path, f'<path value="."/>{mesh}', **{"sub/m.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"})
    assert "no such file" in refusal(tmp_path, include + LAMP)
    assert len(scene(tmp_path, f'<path value="sub"/>{include}{LAMP}').shapes) == 1


@pytest.mark.parametrize(
    ("version", "corner"), [("3.0.0", (0.25 + 0.75 / 2, 0.5, 0.5 * math.sqrt(0.75))), ("0.6.0", (1.0, 0.5, math.sqrt(0.75)))]
)
def test_an_axis_of_another_length_than_1_is_what_it_is_in_that_version(version, corner, tmp_path):
    """cos + (1 - cos) a a^T + sin [a]x for the axis a = (1/2, 0, 0) and 60 degrees, in Mitsuba 3; 0.x made it unit."""
    turn = '<transform name="to_world"><rotate x="0.5" angle="60"/></transform>'
    found = scene(tmp_path, f'<shape type="rectangle">{turn}</shape>{LAMP}', version)
    assert np.abs(found.shapes[0].vertices) == pytest.approx(np.tile(corner, (4, 1)))
    assert any("axis of a rotation" in warning for warning in found.warnings)


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""])
def test_a_byte_order_mark_does_not_count(mark, tmp_path):
    (tmp_path / "m.obj").write_bytes(mark + b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    file = written(tmp_path, f'<shape type="obj"><string name="filename" value="m.obj"/></shape>{LAMP}')
    file.write_bytes(mark + file.read_bytes())
    assert len(engines.load_scene(file).shapes[0].vertices) == 3
