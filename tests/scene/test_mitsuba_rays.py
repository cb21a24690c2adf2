"""Single rays through what a Mitsuba file says in unusual ways: emitters by reference, windows of cameras, raw constants.

Values are closed forms; Mitsuba 3.9.1 (scalar_rgb) gives the same for these files, but where a note says otherwise.
"""

import numpy as np
import pytest

import engines
from engines.image import write_image
from engines.scene import ImageTexture, Orthographic
from tests.scene.mitsuba_files import LAMP, SUN, radiance, refusal, scene

PANE = '<shape type="rectangle">{}</shape>'


def test_an_area_emitter_may_be_that_of_one_shape_by_reference(tmp_path):
    glow = '<emitter type="area" id="glow"><rgb name="radiance" value="2"/></emitter>'
    lit = PANE.format('<ref id="glow"/>')
    for body in (glow + lit, lit + glow):
        assert radiance(tmp_path, body) == pytest.approx([2.0] * 3)
    other = PANE.replace("rectangle", "sphere").format('<ref id="glow"/>')
    assert "its emitter is that of" in refusal(tmp_path, glow + lit + other)
    alone = scene(tmp_path, glow + PANE.format("") + LAMP)
    assert not alone.materials[0].emits and any("area emitter of no shape" in warning for warning in alone.warnings)


FILM = '<film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/></film>'
LOOK = '<lookat origin="0,0,4" target="0,0,0" up="0,1,0"/>'


def window(folder, steps, clip=""):
    sensor = f'<sensor type="orthographic"><transform name="to_world">{steps}{LOOK}</transform>{FILM}{clip}</sensor>'
    floor = '<shape type="rectangle"><transform name="to_world"><translate z="-90"/></transform></shape>'
    found = scene(folder, PANE.format("") + floor + LAMP, sensor=sensor).camera
    assert isinstance(found, Orthographic)
    return found


def test_the_scale_of_an_orthographic_sensor_is_that_of_its_window(tmp_path):
    for steps in ('<scale value="1.5"/>', '<scale x="1.5" y="1.5"/>', '<scale x="1.5" y="1.5" z="7"/>'):
        found = window(tmp_path, steps)
        assert found.window(48 / 32) == pytest.approx((3.0, 2.0)) and found.window(1.0) == pytest.approx((3.0, 3.0))
    found = window(tmp_path, '<scale x="2" y="1"/>')
    assert found.window(48 / 32) == pytest.approx((4.0, 2.0 * 32 / 48)) and found.width == pytest.approx(4.0)


def test_the_scale_along_z_moves_the_near_plane_alone(tmp_path):
    clip = '<float name="near_clip" value="2"/><float name="far_clip" value="22"/>'
    assert window(tmp_path, '<scale z="3"/>', clip).clip == pytest.approx((6.0, 26.0))


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_an_orthographic_window_may_be_wider_than_its_pixels_are_square(engine):
    """Of a window of 8 x 2 the disk of radius 1 fills a quarter of the width, whatever the shape of the image."""
    found = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "orthographic", "eye": [0, 0, 5], "target": [0, 0, 0], "height": 2, "width": 8},
            "materials": {"lamp": {"kd": 0, "emission": 1}},
            "shapes": [{"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}, "material": "lamp"}],
        }
    )
    settings = engines.Settings(64, 16, shader={"name": "path_tracer", "max_depth": 1}, sampler="sobol")
    image = engines.engine(engine).prepare(found, settings).render(4).sums[..., 0] / 4
    assert image[:, :23].max() == image[:, 41:].max() == 0.0 and image[8, 25:39].min() == 1.0
    assert image.mean() == pytest.approx(np.pi / 16, abs=0.01)


RAW = '<texture type="rawconstant" name="{}"><{} name="value" {}/></texture>'
THREE = [0.1, 0.2, 0.3]
XYZ = 'x="0.1" y="0.2" z="0.3"'


@pytest.mark.parametrize(
    ("kind", "value", "truth"),
    [("float", 'value="0.25"', [0.25] * 3), ("vector", 'value="0.1, 0.2 0.3"', THREE), ("point", XYZ, THREE)],
)
def test_a_raw_constant_is_a_number_or_three(kind, value, truth, tmp_path):
    body = PANE.format(f'<bsdf type="diffuse">{RAW.format("reflectance", kind, value)}</bsdf>')
    assert radiance(tmp_path, body + SUN) == pytest.approx(truth)


def test_a_raw_constant_is_a_normal_map_everywhere(tmp_path):
    """(0.8, 0.5, 0.9) is the normal (0.6, 0, 0.8): 0.5 times its cosine, times the factor of the shadows of
    docs/transport.md, which is 1 for light along the surface's normal."""
    tilt = RAW.format("normalmap", "vector", 'value="0.8 0.5 0.9"')
    body = f'<bsdf type="normalmap">{tilt}<bsdf type="diffuse"/></bsdf>'
    assert radiance(tmp_path, PANE.format(body) + SUN) == pytest.approx([0.4] * 3)
    found = scene(tmp_path, PANE.format(body) + SUN).materials[0].bsdf
    assert isinstance(found.map, ImageTexture)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('<bsdf type="mask">' + RAW.format("opacity", "vector", XYZ) + '<bsdf type="diffuse"/></bsdf>', "a number is expected"),
        ('<bsdf type="diffuse">' + RAW.format("reflectance", "vector", 'value="0.1 1.2 0"') + "</bsdf>", "must lie in [0, 1]"),
        ('<bsdf type="diffuse">' + RAW.format("reflectance", "rgb", 'value="0.1"') + "</bsdf>", "a <float> or a <vector>"),
    ],
)
def test_raw_constants_that_have_no_meaning_are_refused(body, said, tmp_path):
    assert said in refusal(tmp_path, PANE.format(body))


def test_negative_texels_of_an_environment_are_black_and_noted(tmp_path):
    image = np.full((4, 8, 3), 0.5, np.float32)
    image[2, 3] = -0.002, 0.5, 0.5
    write_image(tmp_path / "sky.exr", image)
    found = scene(tmp_path, '<shape type="sphere"/><emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>')
    assert found.lights[0].image.min() == 0.0 and found.lights[0].image[2, 3].tolist() == [0.0, 0.5, 0.5]
    assert any("1 texels with negative radiance, down to -0.002, are taken as 0" in warning for warning in found.warnings)


def test_a_binary_ply_file_may_mix_polygons(tmp_path):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4").tobytes()
    faces = b"\3" + np.array([0, 1, 2], "<i4").tobytes() + b"\4" + np.array([0, 1, 2, 3], "<i4").tobytes()
    (tmp_path / "m.ply").write_bytes(head.encode() + corners + faces)
    found = scene(tmp_path, '<shape type="ply"><string name="filename" value="m.ply"/></shape>')
    assert found.shapes[0].faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
