"""Spot lights with a texture and projectors of Mitsuba's files shine as in Mitsuba, in every direction; what is written for
Mitsuba does, too."""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.image import write_image
from engines.peers.export import export
from engines.scene import Checkerboard, ImageTexture, Perspective, Plane, ProjectorLight, SpotLight
from tests.mitsuba.peer import mi
from tests.needs import marks_of, needs
from tests.numpy_reference.small_scenes import path_tracer, renderer, scene
from tests.scene.mitsuba_files import SENSOR, written

pytestmark = [needs("mitsuba-scalar"), pytest.mark.usefixtures("scalar_rgb")]

TEXELS = np.random.default_rng(5).uniform(0.0, 3.0, (3, 5, 3)).astype(np.float32)
FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
LOOK = '<lookat origin="1,2,3" target="0.4,0,0.2" up="0.3,1,0"/>'
PLACE, MIRROR, LARGE = (
    f'<transform name="to_world">{first}{LOOK}</transform>' for first in ("", '<scale x="-1"/>', '<scale value="2"/>')
)
TURN = '<transform name="to_uv"><rotate z="1" angle="25"/><scale x="1.3"/><translate x="0.1"/></transform>'
CONE = '<float name="cutoff_angle" value="35"/><rgb name="intensity" value="1,2,3"/>'
FOV = '<float name="fov" value="50"/>'


def bitmap(name, more=""):
    file = '<string name="filename" value="texels.exr"/><boolean name="raw" value="true"/>'
    return f'<texture type="bitmap" name="{name}">{file}<string name="wrap_mode" value="mirror"/>{more}</texture>'


def board(name):
    return f'<texture type="checkerboard" name="{name}"><rgb name="color0" value="0.9,0.5,0.2"/></texture>'


def along(axis):
    return f'{FOV}<string name="fov_axis" value="{axis}"/>'


EMITTERS = {
    "spot": PLACE + CONE + bitmap("texture"),
    "spot, turned texture": PLACE + CONE + bitmap("texture", TURN),
    "spot, mirrored": MIRROR + CONE + bitmap("texture", TURN),
    "spot, larger": LARGE + CONE + bitmap("texture"),
    "spot, checkerboard": PLACE + CONE + board("texture"),
    "projector": PLACE + FOV + bitmap("irradiance"),
    "projector, turned texture": PLACE + FOV + bitmap("irradiance", TURN),
    "projector, mirrored": MIRROR + FOV + bitmap("irradiance", TURN),
    "projector, larger": LARGE + FOV + bitmap("irradiance") + '<float name="scale" value="3"/>',
    "projector, 50mm": PLACE + bitmap("irradiance"),
    **{f"projector, {axis}": PLACE + along(axis) + bitmap("irradiance") for axis in ("y", "smaller", "larger", "diagonal")},
    "projector, checkerboard": PLACE + FOV + board("irradiance"),
    "projector, colour": PLACE + FOV + '<rgb name="irradiance" value="1,2,3"/>',
    "projector, nothing": PLACE,
}


def assert_equal(light, file, n=400):
    """What arrives at points around the way from (1, 2, 3) to (0.4, 0, 0.2): some of them are lit, some are not."""
    random = np.random.default_rng(2)
    way = random.normal((-0.6, -2.0, -2.8), 1.0, (n, 3)) * random.uniform(0.3, 2.0, (n, 1))
    points = np.array([[1.0], [2.0], [3.0]]) + way.T
    draws = [np.zeros(n)] * 3
    found = renderer(scene([FLOOR], lights=[light]))._context.lights.sample(np.zeros(n, int), points, 0.0 * points, *draws)
    (emitter,) = mi.load_file(str(file)).emitters()
    expected = np.zeros((3, n))
    for i in range(n):
        at = mi.SurfaceInteraction3f()
        at.p = points[:, i]
        expected[:, i] = np.ravel(emitter.sample_direction(at, mi.Point2f(0.5), True)[1])
    close = np.isclose(found.weight, expected, rtol=2e-4, atol=2e-5 * expected.max()).all(axis=0)
    assert close.mean() > 0.99  # all but those at the edge of a square or of the frame
    assert 0.05 < (expected > 0.0).any(axis=0).mean() < 0.95


@pytest.mark.parametrize("name", EMITTERS)
def test_an_imported_light_shines_as_in_mitsuba(name, tmp_path):
    write_image(tmp_path / "texels.exr", TEXELS)
    emitter = f'<emitter type="{name.split(",")[0]}">{EMITTERS[name]}</emitter>'
    file = written(tmp_path, f'<shape type="sphere"/>{emitter}')
    assert_equal(engines.load_scene(file).lights[0], file)


DIRECTION = tuple(np.divide((-0.6, -2.0, -2.8), np.linalg.norm((-0.6, -2.0, -2.8))).tolist())
IMAGE = ImageTexture(TEXELS, wrap="clamp", to_uv=(0.8, -0.6, 0.17, 0.6, 0.8, -0.31))
BOARD = Checkerboard((3.0, 2.0, 1.0), (0.0, 0.5, 0.5))
WRITTEN = {
    "spot, checkerboard": SpotLight((1.0, 2.0, 3.0), DIRECTION, (1.0, 2.0, 3.0), 30.0, 25.0, BOARD, (0.0, 0.6, 0.8)),
    "spot": SpotLight((1.0, 2.0, 3.0), DIRECTION, (1.0, 2.0, 3.0), 30.0, 25.0, IMAGE, (0.0, 0.6, 0.8)),
    "projector": ProjectorLight((1.0, 2.0, 3.0), DIRECTION, (1.0, 0.0, 0.0), (2.0, 2.0, 2.0), IMAGE, 40.0, "y"),
    "coloured": ProjectorLight((1.0, 2.0, 3.0), DIRECTION, (0.0, 1.0, 0.0), (0.0, 4.0, 2.0), IMAGE, 60.0, "x"),
    "checkerboard": ProjectorLight((1.0, 2.0, 3.0), DIRECTION, (0.0, 1.0, 0.0), (0.0, 4.0, 2.0), BOARD, 60.0, "x"),
    "black": ProjectorLight((1.0, 2.0, 3.0), DIRECTION, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), IMAGE, 60.0, "x"),
}


@pytest.mark.parametrize("name", [name for name in WRITTEN if name != "black"])
def test_a_light_written_for_mitsuba_shines_there_as_here(name, tmp_path):
    file = export(scene([FLOOR], lights=[WRITTEN[name]]), "mitsuba", tmp_path / "light.xml")
    assert_equal(WRITTEN[name], file)


def test_a_black_projector_can_be_written(tmp_path):
    file = export(scene([FLOOR], lights=[WRITTEN["black"]]), "mitsuba", tmp_path / "light.xml")
    assert engines.load_scene(file).lights[0].irradiance == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", ["spot", "projector"])
def test_mitsuba_renders_a_file_as_raybench_does(name, tmp_path):
    """A floor seen from the light: the means over 4 x 8 pixels of smooth colours."""
    write_image(tmp_path / "texels.exr", TEXELS)
    place = '<transform name="to_world"><rotate x="1" angle="-90"/><scale value="9"/></transform>'
    sensor = SENSOR.replace('origin="0,0,-5" target="0,0,0"', 'origin="1,2,3" target="0.4,0,0.2"')
    sensor = sensor.replace("</film>", '<rfilter type="box"/></film>')
    path = '<integrator type="path"><integer name="max_depth" value="2"/></integrator>'
    body = f'<shape type="rectangle">{place}</shape><emitter type="{name}">{EMITTERS[name]}</emitter>{path}'
    file = written(tmp_path, body, sensor=sensor)
    ours = renderer(engines.load_scene(file), shader=path_tracer(), sampler="sobol", seed=4).render(256).mean()
    theirs = np.array(mi.render(mi.load_file(str(file)), spp=1024, seed=3))
    assert np.abs(ours - theirs).max() < 0.03 * theirs.max() and np.abs(ours.mean() / theirs.mean() - 1.0) < 0.004


@pytest.mark.parametrize("engine", [pytest.param(name, marks=marks_of(name)) for name in ("mitsuba", "mitsuba_scalar")])
@pytest.mark.parametrize("name", ["spot", "coloured"])
def test_mitsubas_engines_show_the_light_as_numpy_does(name, engine):
    camera = Perspective((1.0, 2.0, 3.0), (0.4, 0.0, 0.2), (0.0, 1.0, 0.0), 20.0, "y", (4, 4))
    held, shader = scene([FLOOR], lights=[WRITTEN[name]], camera=camera), path_tracer()
    theirs, ours = (
        engines.engine(one)
        .prepare(held, Settings(shader=shader, sampler="random", precision=precision, seed=1))
        .render(256)
        .mean()
        for one, precision in ((engine, "float32"), ("numpy", "float64"))
    )
    assert np.abs(theirs - ours).max() < 0.04 * ours.max() and ours.min(axis=(0, 1))[2] > 0.0
