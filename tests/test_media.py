"""Media: closed forms in every engine that renders them, and what holds for every estimator (docs/transport.md, "Media")."""

import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.scene import (
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Group,
    HomogeneousMedium,
    Instance,
    Mask,
    Material,
    Mixture,
    Null,
    Orthographic,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sphere,
    ThinDielectric,
)

ENGINES = [("numpy", None), ("numba", "float64"), ("numba", "float32"), ("embree", "float32")]
"""Those that render media, and their precisions."""
CLEAR = Material("clear", bsdf=Null())
SKY = EnvironmentLight((1.0,) * 3)
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
SUN = DirectionalLight(DOWN, (1.0,) * 3)
LARGEST_Z = 4.0
"""Standard errors by which means may differ: seeds are fixed, so that tests pass or fail for ever."""


@pytest.fixture(params=ENGINES, ids=lambda engine: "-".join(filter(None, engine)))
def engine(request):
    return request.param


def volumetric(max_depth=1000, **options):
    return {"name": "volumetric_path_tracer", "max_depth": max_depth, "rr_depth": 1_000_000, **options}


def medium(sigma_t=1.0, albedo=0.0, g=0.0):
    sigma_t, albedo = (tuple(np.broadcast_to(value, 3).tolist()) for value in (sigma_t, albedo))
    return HomogeneousMedium("medium", sigma_t, albedo, g)


def view(eye, target, side=32, up=(0.0, 1.0, 0.0), **more):
    """A camera whose pixels all see one point."""
    return Perspective(eye, target, up, 1e-5, "y", (side, side), **more)


def scene(shapes, media, lights=(), camera=None, materials=(CLEAR,)):
    camera = camera or view((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
    return Scene("media", camera, tuple(materials), tuple(shapes), tuple(lights), "", media=tuple(media))


def film(made, engine=("numpy", None), spp=1, seed=1, sampler="sobol", **shader):
    settings = Settings(shader=volumetric(**shader), sampler=sampler, seed=seed, precision=engine[1])
    found = engines.engine(engine[0]).prepare(made, settings).render(spp)
    assert found.bad_samples == 0
    return found.mean()


def check(image, truth, most=0.02):
    """The mean of each channel is the truth, by the standard error of pixels, whose scrambles are independent; that is at most
    the share `most`."""
    truth = np.broadcast_to(truth, 3)
    pixels = image.reshape(-1, 3)
    error = pixels.std(axis=0, ddof=1) / math.sqrt(len(pixels))
    assert (error <= most * truth).all(), f"standard errors {error} of {truth} find nothing"
    wrong = np.abs(pixels.mean(axis=0) - truth)
    assert (wrong <= LARGEST_Z * error + 1e-6 * truth).all(), f"{pixels.mean(axis=0)} +- {error}, not {truth}"


def layers(*heights):
    """Planes that face up, from the lowest to the highest: the k-th medium lies above the k-th plane."""
    count = len(heights)
    return [
        Plane((0.0, 0.0, z), UP, 0, exterior=k if k < count - 1 else None, interior=k - 1 if k > 0 else None)
        for k, z in enumerate(heights)
    ]


# ---- absorption --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sigma", "truth"), [(0.2, 0.818731), (0.5, 0.606531), (1.0, 0.367879)])
def test_a_slab_absorbs_exponentially(engine, sigma, truth):
    check(film(scene(layers(0.0, 1.0), [medium(sigma)], [SKY]), engine, 8), truth)


@pytest.mark.parametrize("stretch", [1.5, -1.5])
def test_media_of_a_group_stand_in_its_instances_and_a_mirrored_one_keeps_their_sides(engine, stretch):
    """A ball, 3 m deep where it is stretched, and a slab between two disks, as deep as the stretch."""
    slab = Disk((0.0, 0.0, 2.0), UP, 9.0, 0, exterior=0), Disk((0.0, 0.0, 3.0), UP, 9.0, 0, interior=0)
    group = Group("group", (Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0), *slab))
    shown = Instance(group, np.column_stack([np.diag([1.0, 2.0, stretch]), np.zeros(3)]))
    check(film(scene([shown], [medium(0.2)], [SKY]), engine, 16), math.exp(-0.9))


@pytest.mark.parametrize("gap", [False, True])
def test_layers_multiply(engine, gap):
    """Of optical depths 0.5 and 1.5, with vacuum between them or one face."""
    media = [medium(0.5), medium(1.5)]
    shapes = layers(0.0, 1.0, 2.0)
    if gap:
        second = replace(shapes[0], point=(0.0, 0.0, 2.0), exterior=1), replace(shapes[2], point=(0.0, 0.0, 3.0))
        shapes = [*layers(0.0, 1.0), *second]
    check(film(scene(shapes, media, [SKY]), engine, 16), 0.135335, 0.03)


@pytest.mark.parametrize(
    ("inside", "near", "truth"), [(0, 0.01, 0.371577), (0, 0.2, 0.449329), (None, 0.01, 1.0)], ids=["near", "far", "vacuum"]
)
def test_paths_start_in_the_medium_of_the_camera_at_the_near_plane(engine, inside, near, truth):
    camera = view((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), medium=inside, clip=(near, math.inf))
    check(film(scene([Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0)], [medium()], [SKY], camera), engine, 8), truth)


def test_the_sky_of_an_unclosed_medium_is_black(engine):
    made = scene([], [medium((0.0, 0.5, 2.0))], [SKY], view((0.0, 0.0, 0.0), UP, medium=0))
    image = film(made, engine, 4)
    assert not image[..., 1:].any()
    check(image[..., :1].repeat(3, axis=2), 1.0)


def test_distances_count_from_the_surface(engine):
    """Not from where rays start, which is farther away the larger coordinates are. In Mitsuba this slab passes 0.4018."""
    far = 1000.0
    camera = view((0.0, 0.0, far + 5.0), (0.0, 0.0, far))
    check(film(scene(layers(far, far + 1.0), [medium()], [SKY], camera), engine, 16), math.exp(-1.0))


def test_surfaces_that_name_no_medium_change_none(engine):
    """Clear panes inside of a slab, one of which is met from behind."""
    panes = [Disk((0.0, 0.0, z), normal, 9.0, 0) for z, normal in ((0.3, UP), (0.6, DOWN))]
    check(film(scene([*layers(0.0, 1.0), *panes], [medium()], [SKY]), engine, 16), math.exp(-1.0))


def test_reflected_rays_stay_in_the_medium_of_their_side(engine):
    """A mirror below a slab of which it is the lower boundary, and which it names; the camera's ray passes twice."""
    shapes = [Plane((0.0, 0.0, 0.0), UP, 1, exterior=0), *layers(0.0, 1.0)[1:]]
    mirror = Material("mirror", ks=(1.0,) * 3)
    made = scene(shapes, [medium(0.5)], [SKY], materials=[CLEAR, mirror])
    check(film(made, engine, 16), math.exp(-1.0))


# ---- scattering --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("g", "back", "through"),
    [(0.0, 0.0275231, 0.0234199), (0.5, 0.00611625, 0.140520), (-0.3, 0.0730206, 0.00970056), (0.9999, 6.88147e-07, 4683752.0)],
)
def test_a_slab_scatters_once_as_its_phase_function_says(engine, g, back, through):
    """Albedo 0.8, irradiance 1 on the axis, seen from above and from below."""
    for height, truth in ((5.0, back), (-4.0, through)):
        made = scene(layers(0.0, 1.0), [medium(1.0, 0.8, g)], [SUN], view((0.0, 0.0, height), (0.0, 0.0, 0.5)))
        check(film(made, engine, 8, max_depth=2), truth)


@pytest.mark.parametrize(
    ("sigma", "g", "light", "height", "truth"),
    [
        (1.0, 0.0, 3.0, 0.3, 0.00252109),
        ((0.5, 1.0, 4.0), 0.0, 3.0, 0.3, (0.00240531, 0.00252109, 0.00095025)),
        (2.0, 0.6, 3.0, 0.3, 0.00100759),
        (1.0, 0.0, 0.5, -0.2, 0.0195417),
    ],
    ids=["grey", "coloured", "forward", "light inside"],
)
def test_a_ball_scatters_the_light_of_a_point_once(engine, sigma, g, light, height, truth):
    ball = Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0)
    lamp = PointLight((0.0, light, 0.0), (1.0,) * 3)
    made = scene([ball], [medium(sigma, 0.5, g)], [lamp], view((0.0, height, 5.0), (0.0, height, 0.0)))
    check(film(made, engine, 16, max_depth=2), truth)


@pytest.mark.parametrize(("cosine", "truth"), [(1.0, 0.0813061), (0.5, 0.0958624)])
def test_a_half_space_reflects_as_chandrasekhar_says(engine, cosine, truth):
    eye = (5.0 * math.sqrt(1.0 - cosine**2), 0.0, 5.0 * cosine)
    shapes = [Plane((0.0, 0.0, 0.0), UP, 0, interior=0)]
    made = scene(shapes, [medium(1.0, 0.8)], [SUN], view(eye, (0.0, 0.0, 0.0)))
    check(film(made, engine, 4, max_depth=60, rr_depth=4), truth, 0.03)


@pytest.mark.parametrize(
    ("sigma", "g", "lit_by"),
    [
        (3.0, 0.8, "mis"),
        (3.0, 1.0 - 1e-9, "mis"),
        (3.0, -0.9999, "mis"),
        ((0.0, 0.5, 1.0), 0.0, "mis"),
        ((0.0, 0.5, 1.0), 0.0, "light"),
        ((0.5, 2.0, 8.0), 0.5, "bsdf"),
        ((0.5, 2.0, 8.0), 0.5, "mis"),
    ],
    ids=str,
)
def test_a_furnace_of_white_medium_is_white(engine, sigma, g, lit_by):
    """Its sky has radiance 1, and a ball in it is invisible, whatever scatters in it."""
    ball = Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0)
    made = scene([ball], [medium(sigma, 1.0, g)], [SKY], view((0.0, 0.3, 5.0), (0.0, 0.3, 0.0), 16))
    check(film(made, engine, 6, max_depth=200, direct=lit_by), 1.0, 0.05)


def test_the_shortest_flights_end_below_the_surface_that_they_have_left(engine):
    """Light from above reaches all of their ends through it."""
    point, normal = np.array([100.0, 70.0, 130.0]), np.array([0.6, 0.48, 0.64])
    plane, sun = Plane(tuple(point), tuple(normal), 0, interior=0), DirectionalLight(tuple(-normal), (1.0,) * 3)
    camera = Perspective(tuple(point + 5.0 * normal), tuple(point), UP, 60.0, "y", (16, 16))
    made = scene([plane], [medium(1e-3, 1.0)], [sun], camera)
    image = film(made, engine, sampler={"name": "constant", "value": 0.0}, max_depth=2)
    assert image == pytest.approx(0.25 / math.pi, rel=1e-3)


# ---- null lobes --------------------------------------------------------------------------------------------------------

PANES = [(Null(), 1.0), (Mask(0.3, Mixture()), 0.7), (ThinDielectric(1.5), 24 / 26), (Mask(0.3, ThinDielectric(1.5)), 0.976923)]


@pytest.mark.parametrize(("pane", "transmittance"), PANES)
def test_light_samples_pass_null_lobes(engine, pane, transmittance):
    """On a floor of reflectance 0.5, seen from below the pane, in the light of a point at 2 m; in fog of thickness 2."""
    materials = Material("pane", bsdf=pane), Material("floor", kd=(0.5,) * 3)
    for fog, passed in ((0.0, 1.0), (0.5, math.exp(-1.0))):
        shapes = [Plane((0.0, 0.0, 0.0), UP, 1, exterior=0), Disk((0.0, 0.0, 1.0), UP, 4.0, 0)]
        camera = view((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
        made = scene(shapes, [medium(fog)], [PointLight((0.0, 0.0, 2.0), (1.0,) * 3)], camera, materials)
        check(film(made, engine, max_depth=2), 0.5 / math.pi / 4 * transmittance * passed)


@pytest.mark.parametrize(
    ("pane", "transmittance"), [(Null(), 1.0), (Mask(0.5, Mixture()), 0.5), (ThinDielectric(1.5), 24 / 26)]
)
def test_a_lamp_is_seen_through_null_lobes_at_depth_1(engine, pane, transmittance):
    materials = Material("pane", bsdf=pane), Material("lamp", emission=(1.0,) * 3)
    shapes = [Plane((0.0, 0.0, 0.0), UP, 1), *(Disk((0.0, 0.0, z), UP, 4.0, 0) for z in (1.0, 2.0))]
    check(film(scene(shapes, [], materials=materials), engine, 16, max_depth=1), transmittance**2, 0.03)


def test_media_end_at_null_lobes_whatever_max_depth_is(engine):
    """A vertex in the medium at max_depth ends the path; a null lobe at max_depth does not."""
    made = scene(layers(0.0, 1.0), [medium(1.0, 1.0)], [SKY])
    check(film(made, engine, 8, max_depth=1), math.exp(-1.0))


# ---- what holds for every estimator ------------------------------------------------------------------------------------


def _furnace():
    """Nothing absorbs, and all that emits has radiance 1: so has every ray. Balls of coloured media in fog, one of glass, one
    white; a masked and a thin pane; two lamps, one of them in the fog beside a ball."""
    white, lamp = Mixture(kd=(1.0,) * 3), Material("lamp", emission=(1.0,) * 3, two_sided=True)
    glass = Material("glass", ks=(1.0,) * 3, kt=(1.0,) * 3, ior=1.5, fresnel=True)
    materials = [CLEAR, lamp, glass, *(Material("m", bsdf=bsdf) for bsdf in (white, Mask(0.6, white), ThinDielectric(1.5)))]
    media = [medium((0.1, 0.2, 0.3), 1.0, -0.3), medium((1.0, 2.0, 0.0), 1.0, 0.6)]
    shapes = [
        Sphere((0.0, 0.0, 0.0), 4.0, 0, interior=0),
        Sphere((-0.8, 0.0, 0.0), 0.7, 0, interior=1, exterior=0),
        Sphere((0.8, 0.0, 0.6), 0.5, 2, interior=1, exterior=0),
        Sphere((0.8, 0.0, -0.6), 0.5, 3),
        Sphere((-0.6, 0.9, 0.3), 0.2, 1),
        Disk((0.0, -0.5, 1.6), DOWN, 0.6, 1),
        Disk((0.0, -1.2, 0.4), (0.0, 0.6, 0.8), 0.5, 4),
        Disk((0.0, -1.2, -0.4), (0.0, 0.6, -0.8), 0.5, 5),
    ]
    camera = Perspective((0.0, -3.5, 0.0), (0.0, 0.0, 0.0), UP, 50.0, "y", (16, 16), medium=0)
    return scene(shapes, media, [SKY], camera, materials)


OPTIONS = [
    {},
    {"direct": "light"},
    {"direct": "bsdf"},
    {"light_candidates": 4},
    {"rr_depth": 1},
    *({"light_sampler": sampler} for sampler in ("power", "bvh", "spatial")),
    {"light_sampler": "bvh", "light_candidates": 3},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_a_furnace_is_white_whatever_is_in_it(engine, options):
    samples = 8 if options.get("direct") == "light" else 2
    check(film(_furnace(), engine, samples, **{"max_depth": 200, "rr_depth": 8, **options}), 1.0, 0.06)


@pytest.mark.parametrize("scene_name", ["cornell_box", "two_spheres"])
@pytest.mark.parametrize(
    "options",
    [{"rr_depth": 2}, {"direct": "light", "light_sampler": "bvh"}, {"light_candidates": 3}, {"hide_emitters": True}],
    ids=str,
)
def test_without_media_and_null_lobes_it_is_the_path_tracer_that_starts_roulette_later(engine, scene_name, options):
    made = replace(engines.load_scene(scene_name), media=())
    images = []
    for name, later in (("volumetric_path_tracer", 0), ("path_tracer", 1)):
        shader = {"name": name, "max_depth": 6, **options, "rr_depth": options.get("rr_depth", 5) + later}
        settings = Settings(16, 12, shader=shader, sampler="sobol", seed=5, precision=engine[1])
        images.append(engines.engine(engine[0]).prepare(made, settings).render(3).mean())
    assert images[0].any()
    assert np.array_equal(*images)


def test_other_shaders_render_the_surfaces_alone(engine):
    made, plain = _furnace(), replace(_furnace(), media=())
    plain = replace(plain, shapes=tuple(replace(each, interior=None, exterior=None) for each in plain.shapes))
    plain = replace(plain, camera=replace(plain.camera, medium=None))
    images = []
    for each in (made, plain):
        settings = Settings(shader={"name": "path_tracer", "max_depth": 3}, sampler="random", precision=engine[1])
        images.append(engines.engine(engine[0]).prepare(each, settings).render(1).mean())
    assert np.array_equal(*images)


def test_a_camera_that_moves_into_a_medium_starts_in_it(engine):
    outside = view((0.0, 0.0, 0.0), UP)
    made = scene([Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0)], [medium()], [SKY], outside)
    renderer = engines.engine(engine[0]).prepare(made, Settings(shader=volumetric(), sampler="random", precision=engine[1]))
    assert renderer.render(1).mean() == pytest.approx(1.0)
    renderer.update(camera=replace(outside, medium=0))
    check(renderer.render(8).mean(), math.exp(-1.0))


def test_media_that_the_scene_does_not_have_are_refused(engine):
    ball = Sphere((0.0, 0.0, 0.0), 1.0, 0, interior=0)
    made, settings = scene([ball], [medium()], [SKY]), Settings(shader=volumetric(), sampler="random", precision=engine[1])
    renderer = engines.engine(engine[0]).prepare(made, settings)
    before = renderer.render(1).mean()
    shown = Instance(Group("group", (replace(ball, exterior=1),)), np.eye(3, 4))
    for change, said in (
        ({"camera": replace(made.camera, medium=7)}, r"^camera\.medium = 7: must be a place among the 1 media of the scene$"),
        ({"camera": replace(made.camera, medium=-1)}, r"^camera\.medium = -1: "),
        ({"shapes": (ball, replace(ball, interior=7))}, r"^shapes\[1\]: shape\.interior = 7: "),
        ({"shapes": (shown,)}, r"^groups\.group\[0\]: shape\.exterior = 1: "),
    ):
        with pytest.raises(Unsupported, match=said):
            engines.engine(engine[0]).prepare(replace(made, **change), settings)
        with pytest.raises(Unsupported, match=said):
            renderer.update(**change)
    assert np.array_equal(renderer.render(0).mean(), before)


def test_an_orthographic_camera_in_a_medium_sees_depth(engine):
    """Brightness falls with the distance of what emits."""
    lamp = Material("lamp", emission=(1.0,) * 3)
    camera = Orthographic((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (16, 16), medium=0)
    made = scene([Plane((0.0, 0.0, 0.0), UP, 0)], [medium((0.2, 0.5, 1.0))], [], camera, [lamp])
    check(film(made, engine, 64), np.exp([-0.4, -1.0, -2.0]), 0.03)
