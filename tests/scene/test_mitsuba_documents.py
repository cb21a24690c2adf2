"""What becomes of a Mitsuba file besides its plugins: parameters, includes, aliases, notes, transforms."""

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
        ('<bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="h.png"/></texture>'
         '<bsdf type="thindielectric"/></bsdf>', True, True),
    ],
)  # fmt: skip
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
    (tmp_path / "more.xml").write_text(
        '<scene version="3.0.0"><bsdf type="conductor" id="m"/></scene>', encoding="utf-8"
    )
    found = scene(tmp_path, f'<include filename="more.xml"/><shape type="sphere"><ref id="m"/></shape>{LAMP}')
    assert found.materials[0].name == "m"


def test_an_alias_is_another_id_and_files_are_looked_for_in_paths_first(tmp_path):
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "m.xml").write_text(
        '<scene version="3.0.0"><bsdf type="conductor" id="m"/></scene>', encoding="utf-8"
    )
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
