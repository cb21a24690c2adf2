"""Media in the kernels in float64 against the NumPy engine: the same paths, whatever the boundaries, lights and options."""

from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.scene import (
    Bump,
    Checkerboard,
    Cylinder,
    Dielectric,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Group,
    HomogeneousMedium,
    ImageTexture,
    Instance,
    Mask,
    Material,
    Mesh,
    Mixture,
    Null,
    Perspective,
    Plane,
    PointLight,
    ProjectorLight,
    Scene,
    Sphere,
    SphereSet,
    SpotLight,
    ThinDielectric,
    ThinLens,
    Triangle,
)

SIDE = 16
FOG, SMOKE, INK = range(3)
MEDIA = (
    HomogeneousMedium("fog", (0.1, 0.2, 0.4), (0.9, 0.8, 0.95), -0.3),
    HomogeneousMedium("smoke", (3.0, 3.0, 3.0), (0.9, 0.6, 0.3), 0.7),
    HomogeneousMedium("ink", (0.0, 2.0, 8.0), (0.5, 0.9, 0.0)),
)
UP = (0.0, 0.0, 1.0)
LIGHTS = (
    PointLight((1.5, -2.0, 2.5), (3.0, 2.0, 1.0)),
    SpotLight((-1.5, -1.5, 3.0), (0.48, 0.36, -0.8), (8.0, 9.0, 7.0), 40.0, 20.0),
    DirectionalLight((0.0, 0.6, -0.8), (0.5, 0.4, 0.3)),
)
PATH = {"name": "volumetric_path_tracer", "max_depth": 12, "rr_depth": 3}


def pixels(*size):
    return np.random.default_rng(4).uniform(0.1, 1.5, size).astype(np.float32)


def octahedron(center, radius, material, **sides):
    """With vertex normals."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    faces = [face if np.linalg.det(corners[list(face)]) > 0 else face[::-1] for face in faces]
    vertices, indices = radius * corners + center, np.array(faces, np.int32)
    return Mesh(vertices, indices, np.full(8, material, np.int32), normals=corners, **sides)


def everything(lights=LIGHTS, **camera):
    """Boundaries of every shape: clear, of glass, masked; lamps in media and outside; panes that bound none."""
    bsdfs = [
        Null(),
        Mixture(kd=Checkerboard((0.8, 0.3, 0.2), (0.2, 0.3, 0.8))),
        Dielectric(1.4, (0.3, 0.2)),
        Mixture(ks=(1.0,) * 3, kt=(1.0,) * 3, ior=1.5, fresnel=True),
        Mask(Checkerboard((0.2,) * 3, (0.7,) * 3), Bump(ImageTexture(pixels(5, 7, 1)), 0.1, ThinDielectric(1.5))),
    ]
    lamps = Material("lamp", emission=(7.0, 6.0, 5.0)), Material("glow", emission=Checkerboard(), two_sided=True)
    materials = (*(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs)), *lamps)
    clear, floor, rough, glass, masked, lamp, glow = range(7)
    shapes = (
        Sphere((0.0, 0.0, 1.0), 6.0, clear, interior=FOG),
        Plane((0.0, 0.0, 0.0), UP, floor),
        Sphere((0.5, 0.2, 0.7), 0.6, clear, interior=SMOKE, exterior=FOG),
        octahedron((-0.8, 0.1, 0.8), 0.7, rough, interior=INK, exterior=FOG),
        SphereSet(np.array([(0.0, -1.2, 0.3), (0.6, -1.2, 0.3)]), np.array([0.25, 0.3]), glass, interior=SMOKE, exterior=FOG),
        Cylinder((-1.4, 1.2, 1.9), (0.6, 1.3, 1.7), 0.3, clear, interior=INK, exterior=FOG),
        Disk((-0.7, -1.0, 0.5), (0.6, -0.8, 0.0), 0.5, masked, exterior=FOG, interior=FOG),
        Disk((0.9, -0.6, 1.6), (0.0, -0.6, -0.8), 0.4, masked),
        Sphere((0.5, 0.2, 0.8), 0.1, lamp),
        Disk((0.0, 0.5, 2.8), (0.0, 0.0, -1.0), 0.5, lamp),
        Triangle((1.6, 0.8, 0.2), (1.6, 1.2, 1.4), (1.2, 1.4, 0.4), glow),
    )
    view = Perspective((0.3, -4.0, 1.9), (0.0, 0.0, 0.8), UP, 42.0, "y", (SIDE, SIDE), medium=FOG)
    return Scene("everything", replace(view, **camera), materials, shapes, tuple(lights), "", media=MEDIA)


def room():
    """Triangles alone, and no null lobes."""
    plain = engines.load_scene("cornell_box")
    return replace(plain, media=MEDIA[:1], camera=replace(plain.camera, medium=0))


def assert_equal(scene, sampler="sobol", accelerator="bvh", edges=0, **options):
    """No pixel differs by more than 1e-8 of the brightest, but for as many as see `edges`."""
    images = []
    for engine, own in (("numpy", {}), ("numba", {"precision": "float64", "accelerator": accelerator})):
        settings = Settings(SIDE, SIDE, shader={**PATH, **options}, sampler=sampler, seed=5, **own)
        film = engines.engine(engine).prepare(scene, settings).render(3)
        assert film.bad_samples == 0
        images.append(film.mean())
    reference, found = images
    assert reference.max() > 0.1
    difference = np.abs(found - reference).max(axis=2) / reference.max()
    assert (difference >= 1e-8).sum() <= edges, np.argwhere(difference >= 1e-8)


OPTIONS = (
    {},
    {"direct": "light"},
    {"direct": "bsdf"},
    {"hide_emitters": True},
    {"light_candidates": 4},
    {"light_sampler": "power"},
    {"light_sampler": "bvh"},
    {"light_sampler": "bvh", "light_candidates": 3},
    {"rr_depth": 1, "max_depth": 40},
    {"max_depth": 1},
)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_numba_in_float64_equals_the_reference_where_media_touch_everything(options):
    # light samples of a sky do not reach what frosted glass refracts, which the two weight differently with `light`
    lights = LIGHTS if options == {"direct": "light"} else (*LIGHTS, EnvironmentLight((0.4, 0.5, 0.7)))
    assert_equal(everything(lights), **options)


@pytest.mark.parametrize("options", [{}, {"light_sampler": "spatial"}, {"hide_emitters": True}], ids=str)
def test_numba_in_float64_equals_the_reference_in_a_room_of_fog(options):
    assert_equal(room(), **options)


def test_numba_in_float64_equals_the_reference_in_media_under_an_image_of_the_sky():
    assert_equal(everything([EnvironmentLight((1.0, 0.8, 0.6), pixels(6, 9, 3))]))


def test_numba_in_float64_equals_the_reference_in_media_under_lights_that_show_textures():
    above, down, image = (0.2, -0.8, 3.2), (0.0, 0.28, -0.96), ImageTexture(pixels(5, 7, 3))
    spot = SpotLight(above, down, (8.0, 9.0, 7.0), 40.0, 20.0, image, (0.0, 1.0, 0.0))
    projector = ProjectorLight(above, down, (1.0, 0.0, 0.0), (2.0, 2.0, 2.0), image, 60.0, "y")
    for light in (spot, projector):
        assert_equal(everything([light]))


@pytest.mark.parametrize("sampler", ["random", "halton", "stratified", "constant"])
def test_numba_in_float64_equals_the_reference_in_media_with_every_sampler(sampler):
    assert_equal(room(), sampler, edges=1 if sampler == "constant" else 0)


@pytest.mark.parametrize("accelerator", ["none", "grid", "area_hierarchy"])
def test_numba_in_float64_equals_the_reference_in_media_with_every_accelerator(accelerator):
    assert_equal(everything(), accelerator=accelerator)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_numba_in_float64_equals_the_reference_where_boundaries_of_media_are_instances(mirror):
    scene = everything()
    outer, inner = scene.shapes[:2], scene.shapes[2:8]
    shown = Instance(Group("group", inner), np.array([[0.9, 0.1, 0.0, 0.1], [0.0, mirror, 0.0, 0.2], [0.0, 0.1, 1.1, 0.0]]))
    assert_equal(replace(scene, shapes=(*outer, shown, *scene.shapes[8:])))


def test_a_lens_and_clipped_rays_start_in_the_medium_in_the_kernels_too():
    scene = everything(clip=(1.5, 6.0))
    assert_equal(scene)
    eye, target = (0.3, -4.0, 1.9), (0.0, 0.0, 0.8)
    lens = ThinLens(eye, target, UP, 42.0, "y", (SIDE, SIDE), aperture_radius=0.1, focus_distance=4.0, medium=FOG)
    assert_equal(replace(scene, camera=lens))


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_paths_that_carry_no_light_add_none_in_media(engine):
    """A red and a green wall leave nothing for a third vertex, whatever the channels of the medium behind it are."""
    materials = [Material("clear", bsdf=Null()), *(Material("wall", kd=kd) for kd in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))]
    walls = [Plane((0.0, 0.0, z), (0.0, 0.0, side), k) for z, side, k in ((0.0, 1.0, 1), (1.0, -1.0, 2))]
    ball = Sphere((0.0, 0.0, 0.5), 0.3, 0, interior=0)
    camera = Perspective((3.0, 0.0, 0.5), (0.0, 0.0, 0.5), UP, 60.0, "y", (SIDE, SIDE))
    scene = Scene("walls", camera, tuple(materials), (*walls, ball), (EnvironmentLight((1.0,) * 3),), "", media=MEDIA[INK:])
    film = engines.engine(engine).prepare(scene, Settings(shader=PATH | {"max_depth": 30, "rr_depth": 60})).render(8)
    assert film.bad_samples == 0


def test_the_film_does_not_depend_on_threads_or_calls():
    films = []
    for threads, calls in ((1, (4,)), (2, (1, 3))):
        settings = Settings(40, 40, shader=PATH, sampler="sobol", precision="float32", threads=threads)
        renderer = engines.engine("numba").prepare(everything(), settings)
        films.append([renderer.render(spp) for spp in calls][-1])
    assert np.array_equal(films[0].sums, films[1].sums)


def test_shaders_that_show_no_media_have_no_code_for_them():
    """Nor has the shader that does, in a scene without media: they share machine code with the path tracer."""
    foggy, clear, stages = room(), engines.load_scene("cornell_box"), []
    for scene, shader in (
        (clear, "path_tracer"),
        (foggy, "path_tracer"),
        (clear, "volumetric_path_tracer"),
        (foggy, "volumetric_path_tracer"),
    ):
        renderer = engines.engine("numba").prepare(scene, Settings(SIDE, SIDE, shader=shader, precision="float32"))
        renderer.warm_up()
        stages.append([np.ravel(stage).tolist() for stage in renderer._stages])
    assert stages[0] == stages[1] == stages[2] != stages[3]
