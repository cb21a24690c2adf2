"""Single rays through what a Mitsuba file says in unusual ways: emitters by reference, windows of cameras, raw constants.

Values are closed forms; Mitsuba 3.9.1 (scalar_rgb) gives the same for these files, but where a note says otherwise.
"""

import math

import numpy as np
import pytest

import engines
from engines.image import write_image
from engines.numpy_reference.camera import camera_rays
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


def test_the_near_plane_of_an_orthographic_sensor_clips_far_from_its_middle(tmp_path):
    lamp = '<emitter type="area"/><transform name="to_world"><translate x="8" z="{}"/></transform>'
    film = '<film type="hdrfilm"><integer name="width" value="5"/><integer name="height" value="1"/></film>'
    place = '<transform name="to_world"><scale x="10" y="10"/><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>'
    sensor = f'<sensor type="orthographic"><float name="near_clip" value="1"/>{place}{film}</sensor>'
    for z, seen in ((4.5, 0.0), (3.5, 1.0)):
        found = scene(tmp_path, PANE.format(lamp.format(z)), sensor=sensor)
        settings = engines.Settings(shader={"name": "path_tracer", "max_depth": 1}, sampler="sobol")
        image = engines.engine("numpy").prepare(found, settings).render(16).sums[0, :, 0] / 16
        assert image == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.25 * seen], abs=0.02)  # 4 square metres of a pixel of 16


CROP = "".join(
    f'<integer name="{name}" value="{value}"/>'
    for name, value in {"width": 8, "height": 4, "cropOffsetX": 4, "crop_offset_y": 1, "cropWidth": 2, "crop_height": 2}.items()
)


def cropped(folder, kind, more=""):
    """The camera of a film of 8 x 4 pixels, of which those of 2 x 2 right of the middle are rendered."""
    place = '<transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>'
    sensor = f'<sensor type="{kind}">{place}{more}<film type="hdrfilm">{CROP}</film></sensor>'
    return scene(folder, PANE.format("") + LAMP, "0.6.0", sensor=sensor).camera


def test_a_crop_has_the_pixels_of_the_whole_film(tmp_path):
    tangent = math.tan(math.radians(30.0))
    pixels = {"x": tangent / 4, "y": tangent / 2, "smaller": tangent / 2, "diagonal": tangent / math.sqrt(20)}
    for axis, pixel in pixels.items():
        found = cropped(tmp_path, "perspective", f'<float name="fov" value="60"/><string name="fov_axis" value="{axis}"/>')
        assert found.resolution == (2, 2)
        _, directions = camera_rays(found, np.array([0.5, 1.5]), np.array([0.5, 1.5]), 2, 2)
        first, last = np.array([0.5 * pixel, 0.5 * pixel, -1.0]), np.array([1.5 * pixel, -0.5 * pixel, -1.0])
        assert directions[:, 0] == pytest.approx(first / np.linalg.norm(first))
        assert directions[:, 1] == pytest.approx(last / np.linalg.norm(last))
        if axis == "x":
            assert directions[:, 0] == pytest.approx([0.0718, 0.0718, -0.9948], abs=5e-5)


def test_a_crop_of_an_orthographic_window_is_a_part_of_it(tmp_path):
    found = cropped(tmp_path, "orthographic")
    assert found.window() == (0.5, 0.5)
    origins, _ = camera_rays(found, np.array([0.5]), np.array([0.5]), 2, 2)
    assert origins[:2, 0] == pytest.approx([0.125, 0.125])


def test_a_crop_may_be_any_pixel_of_the_largest_film(tmp_path):
    film = {"width": 65_536, "height": 1, "crop_offset_x": 65_535, "crop_width": 1}
    sides = "".join(f'<integer name="{name}" value="{value}"/>' for name, value in film.items())
    sensor = f'<sensor type="perspective"><float name="fov" value="90"/><film type="hdrfilm">{sides}</film></sensor>'
    found = scene(tmp_path, PANE.format("") + LAMP, sensor=sensor)
    read = engines.load_scene(engines.save_scene(found, tmp_path / "saved")).camera
    _, directions = camera_rays(read, np.array([0.5]), np.array([0.5]), 1, 1)
    assert abs(directions[0, 0] / directions[2, 0]) == pytest.approx(1.0 - 1.0 / 65_536, rel=1e-9)


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


def test_a_constant_volume_is_a_colour(tmp_path):
    volume = '<volume type="constvolume" name="volume"><rgb name="value" value="0.1 0.2 0.3"/></volume>'
    body = PANE.format(f'<bsdf type="diffuse"><texture type="volume" name="reflectance">{volume}</texture></bsdf>')
    assert radiance(tmp_path, body + SUN) == pytest.approx(THREE)


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


def test_a_mask_over_nothing_lets_the_share_of_its_surface_be_seen(tmp_path):
    body = '<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="diffuse"/></bsdf>'
    assert radiance(tmp_path, PANE.format(body) + SUN) == pytest.approx([0.125] * 3)
