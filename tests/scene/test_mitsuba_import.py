"""What each plugin of a Mitsuba file becomes, by value."""

import math

import numpy as np
import pytest

from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Dielectric,
    Diffuse,
    DirectionalLight,
    EnvironmentLight,
    ImageTexture,
    Mask,
    NormalMap,
    Null,
    Orthographic,
    Perspective,
    Plastic,
    PointLight,
    Principled,
    Sides,
    SpotLight,
    ThinDielectric,
    ThinLens,
)
from engines.scene.metals import METALS
from tests.scene.mitsuba_files import LAMP, bsdf, light, refusal, scene

WHITE = (1.0, 1.0, 1.0)
GREY = (0.5, 0.5, 0.5)


def grey(value):
    return (value, value, value)


@pytest.fixture
def image(tmp_path):
    """A file of 2 x 2 texels, grey values 0, 85, 170, 255 row by row."""
    from PIL import Image

    Image.fromarray(np.array([[0, 85], [170, 255]], np.uint8)).save(tmp_path / "t.png")
    Image.fromarray(np.full((2, 2, 3), (128, 128, 255), np.uint8)).save(tmp_path / "n.png")
    return "t.png"


# ---- BSDFs -----------------------------------------------------------------------------------------------------------

MODELS = {
    "diffuse": ('<bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.2, 0.3"/></bsdf>', Diffuse((0.1, 0.2, 0.3))),
    "diffuse default": ('<bsdf type="diffuse"/>', Diffuse(GREY)),
    "roughdiffuse": ('<bsdf type="roughdiffuse"><float name="reflectance" value="0.3"/></bsdf>', Diffuse(grey(0.3))),
    "conductor": ('<bsdf type="conductor"/>', Conductor(grey(0.0), WHITE)),
    "conductor by name": ('<bsdf type="conductor"><string name="material" value="Au"/></bsdf>', Conductor(*METALS["Au"])),
    "roughconductor": (
        '<bsdf type="roughconductor"><float name="alpha" value="0.3"/><rgb name="eta" value="1,2,3"/>'
        '<rgb name="k" value="4,5,6"/>'
        '<string name="distribution" value="ggx"/><rgb name="specular_reflectance" value="0.5"/></bsdf>',
        Conductor((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (0.3, 0.3), GREY, "ggx"),
    ),
    "anisotropic": (
        '<bsdf type="roughconductor"><float name="alpha_u" value="0.3"/><float name="alpha_v" value="0"/></bsdf>',
        Conductor(grey(0.0), WHITE, (0.3, 1e-4), WHITE, "beckmann"),
    ),
    "plastic": (
        '<bsdf type="plastic"><float name="int_ior" value="1.6"/><float name="ext_ior" value="1"/>'
        '<boolean name="nonlinear" value="1"/></bsdf>',
        Plastic(GREY, 1.6, 0.0, True, WHITE, "ggx"),
    ),
    "roughplastic": (
        '<bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.2"/>'
        '<float name="specular_reflectance" value="0.9"/></bsdf>',
        Plastic(grey(0.2), 1.49 / 1.000277, 0.1, False, grey(0.9), "beckmann"),
    ),
    "principled": (
        '<bsdf type="principled"><rgb name="base_color" value="1 0.5 0"/><float name="roughness" value="0.2"/>'
        '<float name="metallic" value="0.9"/><float name="eta" value="1.4"/><float name="clearcoat" value="1"/>'
        '<float name="main_specular_sampling_rate" value="2"/></bsdf>',
        Principled((1.0, 0.5, 0.0), 0.2, metallic=0.9, eta=1.4, clearcoat=1.0),
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_opaque_models_are_black_from_behind_unless_two_sided(tmp_path, name):
    xml, wanted = MODELS[name]
    assert bsdf(tmp_path, xml) == Sides(wanted, None)
    assert bsdf(tmp_path, f'<bsdf type="twosided">{xml}</bsdf>') == wanted


PASSING = {
    "dielectric": ('<bsdf type="dielectric"/>', Dielectric(1.5046 / 1.000277)),
    "substances": (
        '<bsdf type="dielectric"><string name="int_ior" value="water"/><string name="ext_ior" value="air"/></bsdf>',
        Dielectric(1.333 / 1.000277),
    ),
    "roughdielectric": (
        '<bsdf type="roughdielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/>'
        '<rgb name="specular_transmittance" value="0.5"/></bsdf>',
        Dielectric(1.5, (0.1, 0.1), WHITE, GREY, "beckmann"),
    ),
    "thindielectric": ('<bsdf type="thindielectric"><float name="ext_ior" value="1"/></bsdf>', ThinDielectric(1.5046)),
    "principled glass": (
        '<bsdf type="principled"><float name="spec_trans" value="1"/><float name="specular" value="0.5"/></bsdf>',
        Principled(GREY, spec_trans=1.0, eta=2.0 / (1.0 - math.sqrt(0.08 * 0.5)) - 1.0),
    ),
    "null": ('<bsdf type="null"/>', Null()),
    "mask": ('<bsdf type="mask"><bsdf type="diffuse"/></bsdf>', Mask(0.5, Sides(Diffuse(), None))),
    "mask of a colour": (
        '<bsdf type="mask"><rgb name="opacity" value="0.1,0.2,0.6"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>',
        Mask(pytest.approx(0.3), Diffuse()),
    ),
    "blendbsdf": (
        '<bsdf type="blendbsdf"><float name="weight" value="0.2"/><bsdf type="null"/><bsdf type="dielectric"/></bsdf>',
        Blend(0.2, Null(), Dielectric(1.5046 / 1.000277)),
    ),
    "two children": (
        '<bsdf type="twosided"><bsdf type="diffuse"/><bsdf type="conductor"/></bsdf>',
        Sides(Diffuse(), Conductor(grey(0.0), WHITE)),
    ),
}


@pytest.mark.parametrize("name", PASSING)
def test_models_that_pass_light_and_wrappers(tmp_path, name):
    xml, wanted = PASSING[name]
    assert bsdf(tmp_path, xml) == wanted


def test_bump_and_normal_maps_take_images(tmp_path, image):
    found = bsdf(
        tmp_path,
        '<bsdf type="bumpmap"><texture type="bitmap" name="arbitrary"><string name="filename" value="t.png"/>'
        '<boolean name="raw" value="true"/></texture><float name="scale" value="3"/><bsdf type="dielectric"/></bsdf>',
    )
    assert isinstance(found, Bump) and found.scale == 3.0 and isinstance(found.of, Dielectric)
    assert found.height.pixels[:, :, 0] == pytest.approx(np.array([[0, 85], [170, 255]]) / 255)
    found = bsdf(
        tmp_path,
        '<bsdf type="normalmap"><texture type="bitmap" name="normalmap"><string name="filename" value="n.png"/>'
        '<boolean name="raw" value="true"/></texture><bsdf type="diffuse"/></bsdf>',
    )
    assert isinstance(found, NormalMap) and found.of == Sides(Diffuse(), None)
    assert found.map.pixels[0, 0] == pytest.approx([128 / 255, 128 / 255, 1.0])


def test_without_a_bsdf_a_shape_is_grey_and_one_that_emits_is_black(tmp_path):
    found = scene(tmp_path, '<shape type="sphere"/><shape type="disk"><emitter type="area"/></shape>')
    assert found.materials[0].bsdf == Sides(Diffuse(), None)
    assert found.materials[1].bsdf is None
    assert found.materials[1].emission == WHITE and not found.materials[1].two_sided


def test_references_work_before_and_after_what_they_mean_and_share_materials(tmp_path):
    metal = '<bsdf type="conductor" id="m"><string name="material" value="Ag"/></bsdf>'
    glass = '<bsdf type="dielectric" id="g"/>'
    refs = '<shape type="sphere"><ref id="m"/></shape><shape type="sphere"><ref name="bsdf" id="g"/></shape>'
    found = scene(tmp_path, f"{metal}{refs}{refs}{glass}{LAMP}")
    assert [material.name for material in found.materials] == ["m", "g"]
    assert [item.material for item in found.shapes] == [0, 1, 0, 1]


def test_old_names_are_the_same_properties(tmp_path):
    old = '<bsdf type="roughdielectric"><float name="intIOR" value="1.5"/><float name="extIOR" value="1"/>'
    old += '<float name="alphaU" value="0.2"/><float name="alphaV" value="0.3"/>'
    old += '<rgb name="specularReflectance" value="0.5"/></bsdf>'
    assert bsdf(tmp_path, old, "0.5.0") == Dielectric(1.5, (0.2, 0.3), GREY, WHITE, "beckmann")
    diffuse = '<bsdf type="twosided"><bsdf type="diffuse"><srgb name="diffuseReflectance" value="#ff0000"/></bsdf></bsdf>'
    assert bsdf(tmp_path, diffuse, "0.4.0") == Diffuse((1.0, 0.0, 0.0))
    copper = '<bsdf type="twosided"><bsdf type="conductor"/></bsdf>'
    assert bsdf(tmp_path, copper, "0.6.0") == Conductor(*METALS["Cu"])
    metal = '<bsdf type="conductor"><rgb name="eta" value="2"/><rgb name="k" value="4"/><float name="extEta" value="2"/></bsdf>'
    assert bsdf(tmp_path, f'<bsdf type="twosided">{metal}</bsdf>', "0.6.0") == Conductor(WHITE, grey(2.0))


# ---- colours and textures --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("xml", "wanted"),
    [
        ('<rgb name="reflectance" value="0.25"/>', grey(0.25)),
        ('<rgb name="reflectance" value=" 0.1,0.2 , 0.3 "/>', (0.1, 0.2, 0.3)),
        ('<rgb name="reflectance" value="#ffffff" intent="reflectance"/>', WHITE),
        ('<srgb name="reflectance" value="0.5"/>', grey(((0.5 + 0.055) / 1.055) ** 2.4)),
        ('<spectrum name="reflectance" value="0.4"/>', grey(0.4)),
        ('<spectrum name="reflectance" value="0.1 0.2 0.3"/>', (0.1, 0.2, 0.3)),
        ('<spectrum name="reflectance" value="300:0.5, 900:0.5"/>', grey(0.5)),
        ('<float name="reflectance" value="0.4"/>', grey(0.4)),
        ('<spectrum type="uniform" name="reflectance"><float name="value" value="0.4"/></spectrum>', grey(0.4)),
    ],
)
def test_colours(tmp_path, xml, wanted):
    found = bsdf(tmp_path, f'<bsdf type="diffuse">{xml}</bsdf>')
    assert found.front.reflectance == pytest.approx(wanted, rel=2e-4)


def test_a_spectrum_may_stand_in_a_file(tmp_path):
    """It is looked for where other files are, and in the `path` folders of the file that names it, as by Mitsuba 3.9.1."""
    (tmp_path / "sub").mkdir()
    xml = '<bsdf type="diffuse" id="b"><spectrum name="reflectance" {}/></bsdf>'
    inline = bsdf(tmp_path, '<ref id="b"/>', extra=xml.format('value="400:0.1, 500:0.2, 600:0.3, 700:0.1"'))
    (tmp_path / "s.spd").write_text("# nm\n400 0.1\n500\t0.2 # blue\n\n600 0.3\r\n700 0.1", encoding="ascii")
    of_file = xml.format('filename="s.spd"')
    assert bsdf(tmp_path, '<ref id="b"/>', extra=of_file) == inline
    (tmp_path / "s.spd").rename(tmp_path / "sub" / "s.spd")
    (tmp_path / "sub" / "i.xml").write_text(f'<scene version="3.0.0"><path value="."/>{of_file}</scene>', encoding="ascii")
    assert bsdf(tmp_path, '<ref id="b"/>', extra='<path value="sub"/><include filename="i.xml"/>') == inline
    (tmp_path / "sub" / "s.spd").write_text("400 0.1\n400 0.2", encoding="ascii")
    message = refusal(tmp_path / "sub", f'{of_file}<shape type="sphere"><ref id="b"/></shape>')
    assert '<spectrum name="reflectance"> = "400:0.1, 400:0.2": must be pairs wavelength:value' in message


def test_a_flat_spectrum_of_light_is_that_of_equal_energy(tmp_path):
    found = light(tmp_path, '<emitter type="point"><spectrum name="intensity" value="2"/></emitter>')
    assert found.intensity == pytest.approx((2.40958, 1.89658, 1.81784))
    found = light(tmp_path, '<emitter type="point"><spectrum name="intensity" value="300:2 900:2"/></emitter>')
    assert found.intensity == pytest.approx((2.40958, 1.89658, 1.81784), rel=1e-3)


VALUES = '<string name="values" value="1, 2, 3, 1"/>'


@pytest.mark.parametrize(
    ("xml", "wanted"),
    [
        ('<blackbody name="intensity" temperature="3000K" scale="0.5"/>', (366.9, 175.0, 56.41)),
        (
            '<spectrum type="blackbody" name="intensity"><float name="temperature" value="3000"/></spectrum>',
            (733.9, 349.9, 112.8),
        ),
        (
            f'<spectrum type="irregular" name="intensity"><string name="wavelengths" value="400 500 600 700"/>'
            f"{VALUES}</spectrum>",
            (3.2767, 2.3733, 1.2540),
        ),
        (
            f'<spectrum type="regular" name="intensity"><float name="wavelength_min" value="400"/>{VALUES}'
            '<float name="wavelength_max" value="700"/></spectrum>',
            (3.2767, 2.3733, 1.2540),
        ),
        ('<spectrum type="d65" name="intensity"><float name="scale" value="2"/></spectrum>', (2.0, 2.0, 2.0)),
    ],
)
def test_spectra_of_light_have_the_colour_that_mitsubas_spectral_variant_renders(tmp_path, xml, wanted):
    assert light(tmp_path, f'<emitter type="point">{xml}</emitter>').intensity == pytest.approx(wanted, rel=2e-3)


def test_bitmaps(tmp_path, image):
    def reflectance(more="", version="3.0.0"):
        bitmap = f'<texture type="bitmap" name="reflectance"><string name="filename" value="{image}"/>{more}</texture>'
        return bsdf(tmp_path, f'<bsdf type="diffuse">{bitmap}</bsdf>', version).front.reflectance

    plain = reflectance()
    assert isinstance(plain, ImageTexture) and plain.pixels.shape == (2, 2, 1)
    assert (plain.filter, plain.wrap, plain.to_uv) == ("bilinear", "repeat", (1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    assert plain.pixels[0, 1, 0] == pytest.approx(((85 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-5)
    assert reflectance('<boolean name="raw" value="true"/>').pixels[0, 1, 0] == pytest.approx(85 / 255)
    assert reflectance('<float name="gamma" value="2"/>', "0.6.0").pixels[0, 1, 0] == pytest.approx((85 / 255) ** 2)
    more = reflectance('<string name="filter_type" value="nearest"/><string name="wrap_mode" value="mirror"/>')
    assert (more.filter, more.wrap) == ("nearest", "mirror")
    turned = reflectance('<transform name="to_uv"><scale x="2" y="3"/><translate x="0.5"/></transform>')
    assert turned.to_uv == (2.0, 0.0, 0.5, 0.0, 3.0, 0.0)
    old = reflectance('<float name="uscale" value="2"/><float name="uoffset" value="0.25"/>', "0.6.0")
    assert old.to_uv == (2.0, 0.0, 0.5, 0.0, 1.0, 0.0)


def test_a_scale_texture_multiplies(tmp_path, image):
    inner = f'<texture type="bitmap"><string name="filename" value="{image}"/><boolean name="raw" value="true"/></texture>'
    scaled = f'<texture type="scale" name="reflectance"><float name="scale" value="0.5"/>{inner}</texture>'
    xml = f'<bsdf type="diffuse">{scaled}</bsdf>'
    assert bsdf(tmp_path, xml, "0.6.0").front.reflectance.pixels[1, 1, 0] == 0.5


def test_checkerboards_exchange_their_colours_where_a_number_is_wanted(tmp_path):
    board = '<texture type="checkerboard" name="{}"><rgb name="color0" value="0.1"/><rgb name="color1" value="0.9"/></texture>'
    found = bsdf(
        tmp_path, f'<bsdf type="mask">{board.format("opacity")}<bsdf type="diffuse">{board.format("reflectance")}</bsdf></bsdf>'
    )
    assert found.opacity == Checkerboard(grey(0.9), grey(0.1))
    assert found.of.front.reflectance == Checkerboard(grey(0.1), grey(0.9))


# ---- emitters --------------------------------------------------------------------------------------------------------


def test_lights(tmp_path):
    move = '<transform name="to_world"><lookat origin="1,2,3" target="1,2,5" up="0,1,0"/></transform>'
    assert light(tmp_path, f'<emitter type="point">{move}<rgb name="intensity" value="1,2,3"/></emitter>') == PointLight(
        (1.0, 2.0, 3.0), (1.0, 2.0, 3.0)
    )
    assert light(tmp_path, f'<emitter type="spot">{move}</emitter>') == SpotLight(
        (1.0, 2.0, 3.0), (0.0, 0.0, 1.0), WHITE, 20.0, 15.0
    )
    towards = '<vector name="direction" x="0" y="-2" z="0"/><rgb name="irradiance" value="4"/>'
    assert light(tmp_path, f'<emitter type="directional">{towards}</emitter>') == DirectionalLight((0.0, -1.0, 0.0), grey(4.0))
    found = light(tmp_path, '<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>')
    assert isinstance(found, EnvironmentLight) and found.radiance == GREY and found.image is None


def test_environment_maps_keep_rotation_and_rows(tmp_path):
    from engines.image import write_image

    write_image(tmp_path / "e.exr", np.arange(24, dtype=float).reshape(2, 4, 3))
    place = '<transform name="to_world"><rotate y="1" angle="90"/></transform><float name="scale" value="3"/>'
    found = light(tmp_path, f'<emitter type="envmap"><string name="filename" value="e.exr"/>{place}</emitter>')
    assert found.rows == "poles" and found.radiance == grey(3.0) and found.image[1, 3, 2] == 23.0
    assert np.array(found.rotation) == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), abs=1e-12)


# ---- sensors ---------------------------------------------------------------------------------------------------------

LOOK = '<transform name="to_world"><lookat origin="1,2,3" target="1,2,8" up="0,2,0"/></transform>'
FILM = '<film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/></film>'


def camera(folder, kind, more):
    return scene(folder, f'<shape type="sphere"/>{LAMP}', sensor=f'<sensor type="{kind}">{more}{FILM}</sensor>').camera


def test_perspective_sensors(tmp_path):
    found = camera(tmp_path, "perspective", LOOK + '<float name="fov" value="30"/>')
    assert isinstance(found, Perspective) and found.resolution == (200, 100)
    assert (found.eye, found.fov, found.fov_axis, found.mirror) == ((1.0, 2.0, 3.0), 30.0, "x", False)
    assert np.subtract(found.target, found.eye)[:2].tolist() == [0.0, 0.0] and found.target[2] > 3.0
    half = math.tan(math.radians(15))
    for axis, wanted in (("smaller", ("y", half)), ("larger", ("x", half)), ("diagonal", ("x", half * 2 / math.sqrt(5)))):
        found = camera(tmp_path, "perspective", f'<float name="fov" value="30"/><string name="fov_axis" value="{axis}"/>')
        assert found.fov_axis == wanted[0] and math.tan(math.radians(found.fov / 2)) == pytest.approx(wanted[1])
    found = camera(tmp_path, "perspective", '<string name="focal_length" value="35mm"/>')
    assert found.fov == pytest.approx(57.8712, rel=1e-5)  # what Mitsuba 3.9.1 says of this film
    assert camera(tmp_path, "perspective", "").fov == pytest.approx(42.3117, rel=1e-5)
    shifted = camera(tmp_path, "perspective", '<float name="principal_point_offset_x" value="0.1"/>')
    assert shifted.principal_point == (-0.1, 0.0)
    mirrored = camera(tmp_path, "perspective", '<transform name="to_world"><scale x="-1"/></transform>')
    assert mirrored.mirror


def test_thin_lenses_and_orthographic_sensors(tmp_path):
    lens = '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/><float name="fov" value="30"/>'
    found = camera(tmp_path, "thinlens", lens)
    assert isinstance(found, ThinLens) and (found.aperture_radius, found.focus_distance) == (0.1, 4.0)
    found = camera(tmp_path, "orthographic", '<transform name="to_world"><scale value="3"/></transform>')
    assert isinstance(found, Orthographic) and (found.width, found.height) == (pytest.approx(6.0), None)


def test_clipping_planes_are_kept_where_they_clip(tmp_path):
    def clip(near, far, x=0.0):
        planes = f'<float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/><float name="fov" value="30"/>'
        ball = f'<shape type="sphere"><point name="center" x="{x}" y="0" z="5"/></shape>'
        return scene(tmp_path, ball + LAMP, sensor=f'<sensor type="perspective">{planes}{FILM}</sensor>').camera.clip

    assert clip(0.5, 100) == (0.0, math.inf)
    assert clip(0.5, 5) == (0.0, 5.0)
    assert clip(4.5, 100) == (4.5, math.inf)
    assert clip(0.5, 100, x=1000.0) == (0.0, math.inf)
