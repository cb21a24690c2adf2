"""Environment images that are rotated, or whose first and last rows lie on the poles."""

from dataclasses import replace

import numpy as np
import pytest

import engines
from engines.kernels.flatten.environment import place_row, tables
from engines.kernels.layout import RUN
from engines.numpy_reference.lights.image_environment import ImageEnvironment
from engines.scene import EnvironmentLight
from tests.test_engines_agree import _assert_equal, _image

H, W = 6, 10
IMAGE = np.random.default_rng(1).random((H, W, 3)) + np.array([0.2, 0.1, 0.3])
IMAGE[2, 3] += 20.0
PLAIN = EnvironmentLight((1.0, 1.0, 1.0), IMAGE)


def rotation(seed=2):
    """An orthogonal matrix that also mirrors."""
    matrix = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    matrix[:, 0] *= -np.sign(np.linalg.det(matrix))
    x, y, z = (tuple(map(float, row)) for row in matrix)
    return x, y, z


def directions(u, v):
    phi, theta = 2 * np.pi * np.asarray(u), np.pi * np.asarray(v)
    return np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)])


def test_rows_on_the_poles_are_met_at_the_poles_and_the_others_at_equal_steps_between():
    """Column centres stay half a column in; at a pole the direction has no column, so the rows there are made even."""
    image = IMAGE.copy()
    image[0], image[-1] = [3.0, 2.0, 1.0], [0.5, 0.6, 0.7]
    light = ImageEnvironment(EnvironmentLight((2.0, 1.0, 1.0), image, rows="poles"))
    j, i = np.meshgrid(np.arange(W), np.arange(H))
    found = light.Li(directions((j.ravel() + 0.5) / W, i.ravel() / (H - 1)))
    assert np.allclose(found.T.reshape(H, W, 3), image * [2.0, 1.0, 1.0], rtol=1e-12)
    halfway = light.Li(directions([(3 + 0.5) / W], [1.5 / (H - 1)]))[:, 0]
    assert np.allclose(halfway, (image[1, 3] + image[2, 3]) / 2 * [2.0, 1.0, 1.0], rtol=1e-12)
    cells = ImageEnvironment(EnvironmentLight((1.0, 1.0, 1.0), image))
    cells = cells.Li(directions((j.ravel() + 0.5) / W, (i.ravel() + 0.5) / H))
    assert np.allclose(cells.T.reshape(H, W, 3), image, rtol=1e-12)


def test_a_rotated_image_shows_in_a_turned_direction_what_it_shows_in_the_direction_itself():
    turned, plain = ImageEnvironment(replace(PLAIN, rotation=rotation())), ImageEnvironment(PLAIN)
    d = np.random.default_rng(3).normal(size=(3, 500))
    d /= np.linalg.norm(d, axis=0)
    moved = np.array(rotation()) @ d
    assert np.allclose(turned.Li(moved), plain.Li(d), rtol=1e-9)
    assert np.allclose(turned.pdf(moved, d), plain.pdf(d, d), rtol=1e-9)


@pytest.mark.parametrize("rows", ["cells", "poles"])
def test_samples_of_a_rotated_image_have_the_density_they_claim_and_reach_all_its_light(rows):
    """The mean of Li/pdf is the integral of Li, here by quadrature; the pdf of a sample is that of its direction."""
    light = ImageEnvironment(replace(PLAIN, rotation=rotation(), rows=rows))
    n = 800
    grid = (np.stack(np.meshgrid(np.arange(n), np.arange(n))).reshape(2, -1) + 0.5) / n
    wi, pdf = light.sample(np.zeros((3, grid.shape[1])), *grid)
    assert np.allclose(np.linalg.norm(wi, axis=0), 1.0, rtol=1e-14)
    agree = np.isclose(light.pdf(wi, wi), pdf, rtol=1e-6)
    assert agree.mean() > 0.999  # but where rounding takes a direction across the edge of a texel
    u, v = grid
    plain = ImageEnvironment(replace(PLAIN, rows=rows)).Li(directions(u, v))
    truth = (plain * np.sin(np.pi * v)).mean(axis=1) * 2 * np.pi**2
    # Li/pdf jumps between texels, which the grid does not follow: an error of the order of its spacing
    assert np.allclose((light.Li(wi) / pdf).mean(axis=1), truth, rtol=1 / n)


def test_tables_of_the_kernels_know_rotations_and_rows_by_one_row_alone():
    turned = replace(PLAIN, rotation=rotation(), rows="poles")
    for one, other in zip(tables(PLAIN, np.float32), tables(turned, np.float32), strict=True):
        assert np.array_equal(one, other)
    assert place_row(PLAIN)[0].tolist() == [H, 0.5, 1, 0, 0, 0, 1, 0, 0, 0, 1]
    row = place_row(turned)[0]
    assert row[:2].tolist() == [H - 1, 0.0] and np.array_equal(row[2:].reshape(3, 3), np.transpose(rotation()))


def _under(light):
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 1, 5], "target": [0, 0.8, 0], "fov": 60, "resolution": [24, 24]},
            "materials": {
                "white": {"kd": 0.7},
                "mirror": {"ks": 0.9},
                "rough": {"conductor": {"metal": "Au", "alpha": [0.2, 0.3]}},
            },
            "shapes": [
                {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "white"},
                {"sphere": {"center": [-1, 0.8, 0], "radius": 0.8}, "material": "mirror"},
                {"sphere": {"center": [1, 0.8, 0], "radius": 0.8}, "material": "rough"},
            ],
        }
    )
    return replace(scene, lights=(light,))


def test_numba_in_float64_equals_the_reference_under_a_rotated_image_with_rows_on_its_poles():
    for light in (replace(PLAIN, rotation=rotation(), rows="poles"), replace(PLAIN, rows="poles")):
        _assert_equal(_under(light), ["none"], shader="path_tracer", sampler="sobol", spp=3, width=24, height=24)


@pytest.mark.parametrize("width", [1, RUN, RUN + 1, 3 * RUN - 3])
def test_numba_in_float64_equals_the_reference_under_rows_of_one_run_of_texels_and_of_several(width):
    image = np.random.default_rng(width).random((H, width, 3)) ** 4
    image[:3], image[:, 1 : width - 10] = 0.0, 0.0  # black rows, and a black run of the widest
    scene = _under(replace(PLAIN, image=image))
    _assert_equal(scene, ["none"], shader="path_tracer", sampler="sobol", spp=3, width=24, height=24)


def test_the_rotation_that_changes_nothing_changes_no_bit():
    settings = {"shader": "path_tracer", "precision": "float64", "width": 24, "height": 24}
    identity = tuple(tuple(map(float, row)) for row in np.eye(3))
    plain, same = (_image("numba", _under(light), **settings) for light in (PLAIN, replace(PLAIN, rotation=identity)))
    assert np.array_equal(plain, same)
