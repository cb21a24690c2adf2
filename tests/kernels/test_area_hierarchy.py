"""Boxes on the screen lose no hit: camera rays find what the plain list finds, bit for bit, and so do all others."""

from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.kernels.flatten import flatten
from engines.kernels.layout import SceneTable
from engines.kernels.stages.camera import parameters
from engines.numba_cpu.accel.area_hierarchy import Accelerator, AreaTable

EYE = np.array([0.3, -0.2, 5.0])
CAMERA = {"eye": EYE.tolist(), "target": [0, 0.1, 0], "up": [0.1, 1, 0], "resolution": [48, 40]}


def scene_of(shapes, camera_type="perspective", **more):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "set",
            "camera": {"type": camera_type, **CAMERA, **more},
            "materials": {"m": {"kd": 0.4, "ks": 0.5}},
            "lights": [{"environment": {"radiance": 1}}],
            "shapes": [{**shape, "material": "m"} for shape in shapes],
        }
    )


def soup(n, size, seed, middle=(0, 0, 0)):
    random = np.random.default_rng(seed)
    vertices = random.uniform(-1, 1, (n, 1, 3)) + size * random.normal(size=(n, 3, 3)) + middle
    return {"mesh": {"vertices": vertices.reshape(-1, 3).tolist(), "faces": np.arange(3 * n).reshape(-1, 3).tolist()}}


def sphere(center, radius):
    return {"sphere": {"center": [float(x) for x in center], "radius": float(radius)}}


def near(x, y, z):
    """A point relative to the eye."""
    return np.add(EYE, (x, y, z))


PLANE = {"plane": {"point": [0, -2, 0], "normal": [0, 1, 0]}}
SETS = {
    "ahead": [soup(60, 0.2, 1), sphere((0.4, 0.5, 0), 0.6), sphere((-0.5, 0, 1), 0.3), PLANE],
    "around the eye": [soup(40, 3.0, 2, EYE), sphere(near(0.1, 0, 0), 0.5), sphere(near(0, 0, 2), 1.9), PLANE],
    "behind and beside": [soup(30, 0.3, 3, near(0, 0, 3)), sphere(near(2, 0, 0), 1.0), sphere(near(0, 3, -3), 1), PLANE],
    "tiny and far": [soup(30, 1e-3, 4), sphere((0, 0, -1000), 1.0), sphere((0.1, 0.1, 0), 1e-4), PLANE],
}


def aimed_rays(shapes, seed=7):
    """Rays from the eye at random, at vertices, along rims of spheres, and behind the eye."""
    random = np.random.default_rng(seed)
    ahead = random.normal(size=(1600, 3)) * 0.3 - [0, 0, 1]
    around = random.normal(size=(800, 3))
    vertices = np.concatenate([shape["mesh"]["vertices"] for shape in shapes if "mesh" in shape])
    aimed = [np.asarray(vertices) - EYE]
    for shape in shapes:
        if "sphere" in shape:
            away = np.asarray(shape["sphere"]["center"]) - EYE
            side = np.cross(away, random.normal(size=(200, 3)))
            side *= shape["sphere"]["radius"] / np.linalg.norm(side, axis=1, keepdims=True)
            aimed.append(away + side * random.uniform(0.98, 1.02, (200, 1)))
    return np.concatenate([ahead, *aimed, around])


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", SETS)
def test_rays_from_the_eye_and_others_find_the_lists_hits_bit_for_bit(name, precision):
    scene, directions = scene_of(SETS[name]), aimed_rays(SETS[name])
    elsewhere = np.random.default_rng(8).uniform(-2, 2, (len(directions), 3))
    found = {}
    for accelerator in ("none", "area_hierarchy"):
        settings = Settings(48, 40, shader="albedo", accelerator=accelerator, precision=precision)
        renderer = engines.engine("numba").prepare(scene, settings)
        for kind, origins in (("eye", np.tile(EYE, (len(directions), 1))), ("others", elsewhere)):
            found[accelerator, kind] = renderer.trace(origins, directions)
            occluded = renderer.occluded(origins, directions)
            assert np.array_equal(occluded, np.isfinite(found[accelerator, kind].t))
    for kind in ("eye", "others"):
        assert np.isfinite(found["none", kind].t).any()
        for field in ("t", "shape", "primitive", "normal", "u", "v"):
            mine, plain = getattr(found["area_hierarchy", kind], field), getattr(found["none", kind], field)
            assert np.array_equal(mine, plain), f"{kind}: {field}"


@pytest.mark.parametrize("camera", [{}, {"camera_type": "perspective_arctan"}, {"camera_type": "orthographic", "height": 4}])
def test_images_are_the_lists_whatever_the_camera_and_after_it_moved(camera):
    scene = scene_of(SETS["ahead"], **camera)
    images = []
    for accelerator in ("none", "area_hierarchy"):
        settings = Settings(48, 40, shader="albedo", sampler="random", accelerator=accelerator, threads=2)
        renderer = engines.engine("numba").prepare(scene, settings)
        first = renderer.render(2).sums.copy()
        renderer.update(camera=replace(scene.camera, eye=(2.0, 1.0, 3.0)))
        images.append((first, renderer.render(2).sums.copy()))
    assert np.array_equal(images[0][0], images[1][0])
    assert np.array_equal(images[0][1], images[1][1])
    assert not np.array_equal(*images[0])


def test_the_box_of_a_sphere_is_its_outline():
    scene = scene_of([sphere((0, 0, -3), 1.5)], eye=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0])
    flat = flatten(scene, np.float64, np.float64)
    flat.bind(SceneTable.camera, parameters(scene.camera, 8, 8, flat.center))
    accelerator = Accelerator({})
    accelerator.build(flat, 1)
    accelerator.look(flat, has_eye=True)
    assert flat.arrays[AreaTable.boxes] == pytest.approx(np.tan(np.arcsin(0.5)) * np.array([[-1, 1, -1, 1]]), rel=1e-9)
