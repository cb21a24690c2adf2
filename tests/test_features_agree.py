"""Textures, wrappers and the models to which they lead: the kernels in float64 against the NumPy engine, on small scenes
that combine many of them. The two implementations share no code but the scene.
"""

from functools import partial

import numpy as np
import pytest

import engines
from engines import Settings
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Cylinder,
    Dielectric,
    Diffuse,
    Disk,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mesh,
    Mixture,
    NormalMap,
    Null,
    Perspective,
    Plane,
    Plastic,
    PointLight,
    Principled,
    Scene,
    Sides,
    Sphere,
    ThinDielectric,
)

SIDE = 24
CAMERA = Perspective((0.3, -4.0, 1.9), (0.0, 0.0, 0.7), (0.0, 0.0, 1.0), 48.0, "y", (SIDE, SIDE))
TURNED = (0.8, -0.6, 0.17, 0.6, 0.8, -0.31)


@pytest.fixture(autouse=True)
def texels():
    """The same images in every test, whichever ran before."""
    global RNG
    RNG = np.random.default_rng(2)


def image(channels=3, low=0.0, high=1.0, size=(5, 7), **keys):
    pixels = RNG.uniform(low, high, (*size, channels)).astype(np.float32)
    return ImageTexture(pixels, **keys)


def metal(alpha, reflectance=(1.0, 1.0, 1.0)):
    return Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), alpha, reflectance)


def quad(corners, material, uvs=None):
    """Two triangles; `corners` (4, 3) in order around."""
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(np.array(corners, float), faces, np.full(2, material, np.int32), uvs=uvs)


UVS = np.array([[0.1, 0.0], [1.9, 0.2], [1.7, 1.6], [-0.2, 1.3]])
WALL = [(-2.0, 1.5, 0.0), (2.0, 1.6, 0.0), (2.0, 1.4, 2.6), (-2.0, 1.5, 2.4)]
SHEET = [(-1.5, -0.8, 0.2), (-0.3, -1.0, 0.25), (-0.4, -0.6, 1.3), (-1.4, -0.5, 1.1)]
LAMP = Material("lamp", emission=(7.0, 6.0, 5.0))
MATT = Mixture(kd=(0.7, 0.5, 0.3))


def equal(shapes, bsdfs, lights=(), side=SIDE, **settings):
    """Renders both and compares: no pixel may differ by more than 1e-8 of the brightest. The last material is the lamp's."""
    materials = (*(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs)), LAMP)
    scene = Scene("features", CAMERA, materials, tuple(shapes), tuple(lights), "")
    images = []
    for engine, own in (("numpy", {}), ("numba", {"precision": "float64", "accelerator": "none", "threads": 1})):
        chosen = Settings(side, side, seed=5, sampler="sobol", **settings, **own)
        images.append(engines.engine(engine).prepare(scene, chosen).render(2).mean())
    reference, found = images
    assert reference.max() > 0.1
    difference = np.abs(found - reference).max(axis=2) / reference.max()
    assert (difference < 1e-8).all(), np.argwhere(difference >= 1e-8)


def shapes_under_wrappers():
    """Every kind of shape, and the BSDFs of their materials: textures under every wrapper."""
    cutout = Mask(image(1), Blend(image(wrap="mirror"), Mixture(kd=image(filter="nearest")), metal((0.3, 0.3))))
    brushed = NormalMap(
        image(low=0.35, high=0.65, to_uv=TURNED), Bump(image(1, high=0.05), 0.4, metal((image(1, 0.05, 0.5), 0.2)))
    )
    rough_wall = Bump(image(1, high=0.3, wrap="clamp"), 0.5, Sides(Mixture(kd=image(wrap="clamp"), ks=(0.2,) * 3), None))
    both_sides = Sides(Blend(0.4, MATT, metal((0.0, 0.0))), Mask(0.6, Mixture(kt=Checkerboard(), ior=1.3, fresnel=True)))
    shapes = [
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0),
        Sphere((0.5, 0.2, 0.6), 0.6, 1),
        quad(WALL, 2, UVS),
        quad(SHEET, 3, UVS[::-1].copy()),
        Disk((-0.9, 0.6, 0.7), (0.6, -0.8, 0.0), 0.6, 4),
        quad([(0.9, -0.9, 0.0), (1.5, -0.8, 0.1), (1.4, -0.7, 0.9), (0.8, -0.8, 0.8)], 6, UVS),
        Plane((0.0, 0.0, 4.0), (0.36, 0.48, 0.8), 5),
        Cylinder((-0.4, 1.0, 1.9), (0.6, 0.6, 1.7), 0.3, 3),
        Cylinder((-0.2, -1.2, 0.1), (0.2, -1.3, 0.5), 0.2, 1),
    ]
    floor = Mixture(kd=Checkerboard((0.8, 0.3, 0.2), (0.2, 0.3, 0.8), TURNED))
    metals = [metal((0.4, 0.1), image()), metal((0.1, 0.5))]
    return shapes, [floor, NormalMap(image(low=0.3, high=0.7), cutout), rough_wall, brushed, both_sides, *metals]


def every_model():
    """BSDFs of all models, of textured parameters, wrapped and tilted."""
    number = partial(image, 1)
    rough = Dielectric(1.5, (number(low=0.1, high=0.6), 0.3), image(), image())
    return [
        Blend(0.5, Diffuse(image()), NormalMap(image(low=0.3, high=0.7), rough)),
        Dielectric(1.3, (0.4, 0.4), image(), distribution="beckmann"),
        Mask(0.7, ThinDielectric(1.5, image(), image())),
        Bump(number(high=0.1), 0.2, Plastic(image(), 1.5, 0.2, True, image(), "beckmann")),
        Blend(number(), Plastic(image(), 1.6), Null()),
        Principled(image(), *(number() for _ in range(3)), 1.5, *(number() for _ in range(6)), 0.0),
        Bump(number(high=0.1), 0.2, Principled(image(), spec_trans=number(), roughness=0.3, anisotropic=number())),
        Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (number(), 0.2), image(), "beckmann"),
    ]


def test_path_tracer_with_every_model_of_textured_parameters_on_every_shape_under_every_wrapper():
    """A small sphere of each model hovers in front of the other shapes."""
    (shapes, bsdfs), models = shapes_under_wrappers(), every_model()
    shapes += [Sphere((0.15 + 0.23 * (k - 3.5), -2.0, 0.7), 0.11, len(bsdfs) + k) for k in range(len(models))]
    shapes.append(Disk((0.0, -0.5, 3.0), (0.0, 0.0, -1.0), 0.8, len(bsdfs) + len(models)))
    sky = EnvironmentLight(radiance=(0.3, 0.35, 0.4))
    shader = {"name": "path_tracer", "max_depth": 5, "rr_depth": 3}
    equal(shapes, [*bsdfs, *models], [sky], 40, shader=shader)


def test_shaders_of_every_light_with_masks_blends_and_tilted_mirrors():
    glass = Mixture(ks=(0.9,) * 3, kt=(0.9,) * 3, ior=1.5, fresnel=True)
    waves = Bump(image(1, high=0.2), 0.3, Mixture(kd=(0.2, 0.3, 0.3), ks=image()))
    shapes = [
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0),
        Sphere((0.5, 0.2, 0.6), 0.6, 1),
        quad(SHEET, 2, UVS),
        Disk((0.0, -0.5, 3.0), (0.0, 0.0, -1.0), 0.8, 3),
    ]
    veil = Mask(image(1, to_uv=TURNED), Blend(0.3, Mixture(kd=image(), ks=(0.4,) * 3), MATT))
    lights = [PointLight((1.5, -2.0, 2.5), (9.0, 9.0, 9.0))]
    bsdfs = [waves, Blend(0.5, glass, Sides(MATT, glass)), veil]
    for shader in ({"name": "whitted", "max_depth": 4}, {"name": "no_shadows", "ambient": 0.2}, {"name": "albedo"}):
        equal(shapes, bsdfs, lights, shader=shader)
