"""The path tracer's options `transparent_shadows` and `hide_emitters`: closed forms in every engine, and the engines against
each other where all that rays may pass comes together (docs/transport.md, "Null lobes")."""

import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.kernels.layout import LANES, RayBatch
from engines.numpy_reference import context
from engines.numpy_reference import path_tracer as numpy_path_tracer
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    DirectionalLight,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mesh,
    Mixture,
    Null,
    Orthographic,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sides,
    Sphere,
    ThinDielectric,
)

PANE, THIN = ThinDielectric(1.5), 24 / 26  # 1 - 2 F / (1 + F), F = 0.04
PANES = (Null(), Mask(0.3, Mixture()), PANE, Mask(0.3, PANE), Mask(0.5, Mixture()))
TRANSMITTANCES = np.array([1.0, 0.7, THIN, 1.0 - 0.3 * (1.0 - THIN), 0.5])
FLOOR, LAMP = len(PANES), len(PANES) + 1
MATERIALS = (
    *(Material(f"pane {k}", bsdf=bsdf) for k, bsdf in enumerate(PANES)),
    Material("floor", kd=(0.5,) * 3),
    Material("lamp", emission=(1.0,) * 3),
)
ENGINES = [("numpy", None), ("numba", "float32"), ("embree", "float32")]


def path_tracer(**options):
    return {"name": "path_tracer", "rr_depth": 1000, "transparent_shadows": True, **options}


def render(scene, engine="numpy", precision=None, spp=1, seed=3, sampler="sobol", **options):
    """The mean image."""
    tree = "bvh" if engine == "numba" else "auto"
    settings = Settings(
        shader=path_tracer(**options), sampler=sampler, seed=seed, threads=1, precision=precision, accelerator=tree
    )
    film = engines.engine(engine).prepare(scene, settings).render(spp)
    assert film.bad_samples == 0
    return film.mean()


def square(x, y, z, material, half=0.5, rise=0.0):
    """A horizontal square, its front up, which rises along y."""
    corners = [(x - half, y - half, z - rise), (x + half, y - half, z - rise), (x + half, y + half, z + rise)]
    corners = np.array([*corners, (x - half, y + half, z + rise)])
    uvs = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, material, np.int32), uvs=uvs)


# ---- closed forms ------------------------------------------------------------------------------------------------------


def _two_rows(more=()):
    """From above, a column for each pane. In the upper row the floor in light that a pane above the camera lets pass; in the
    lower one a lamp behind two panes. The lamp is a plane, so that the sun is the only light that is sampled."""
    shapes = [Plane((0.0, 0.0, -0.1), (0.0, 0.0, 1.0), LAMP)]
    for k in range(len(PANES)):
        x = k - (len(PANES) - 1) / 2
        shapes += [square(x, 0.5, 0.0, FLOOR), square(x, 0.5, 2.0, k), square(x, -0.5, 0.3, k), square(x, -0.5, 0.6, k)]
    camera = Orthographic((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 2.0, (4 * len(PANES), 8))
    sun = DirectionalLight((0.0, 0.0, -1.0), (1.0,) * 3)
    return Scene("two rows", camera, MATERIALS, (*shapes, *more), (sun,), "")


def _rows(image):
    """(2, panes) means: upper row, lower row."""
    return image.mean(axis=2).reshape(2, 4, len(PANES), 4).mean(axis=(1, 3))


@pytest.mark.parametrize(("engine", "precision"), ENGINES)
def test_light_passes_null_lobes_by_their_transmittance(engine, precision):
    """The floor without noise; of the lamp, independent samples would have a standard error of at most 0.0135."""
    upper, lower = _rows(render(_two_rows(), engine, precision, spp=64, max_depth=2, direct="light"))
    assert upper == pytest.approx(0.5 / math.pi * TRANSMITTANCES, rel=1e-5)
    assert lower == pytest.approx(TRANSMITTANCES**2, abs=0.05)


@pytest.mark.parametrize(("engine", "precision"), ENGINES)
def test_null_lobes_are_no_segments(engine, precision):
    """The lamp is seen through two panes at the first segment. Without the option it is not, nor the light on the floor."""
    upper, lower = _rows(render(_two_rows(), engine, precision, spp=64, max_depth=1))
    assert not upper.any()
    assert lower == pytest.approx(TRANSMITTANCES**2, abs=0.05)
    assert not render(_two_rows(), engine, precision, max_depth=2, transparent_shadows=False).any()


@pytest.mark.parametrize(("pane", "transmittance"), zip(PANES, TRANSMITTANCES, strict=True))
def test_a_point_light_above_a_pane_lights_the_floor_below(pane, transmittance):
    """At 2 m, seen from below the pane, as Mitsuba's volpath has it."""
    shapes = square(0.0, 0.0, 0.0, 1), square(0.0, 0.0, 1.0, 0)
    camera = Perspective((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.01, "y", (4, 4))
    light = PointLight((0.0, 0.0, 2.0), (1.0,) * 3)
    scene = Scene("floor", camera, (Material("pane", bsdf=pane), MATERIALS[FLOOR]), shapes, (light,), "")
    assert render(scene, max_depth=2) == pytest.approx(0.5 / math.pi / 4 * transmittance, rel=1e-5)
    assert not render(scene, max_depth=2, transparent_shadows=False).any()


def _seen_through(pane, light=()):
    """A lamp of radiance 3 behind a pane, or neither where it is None; the sky, where `light` holds one."""
    shapes = () if pane is None else (square(0.0, 0.0, 1.0, 0),)
    shapes += () if light else (square(0.0, 0.0, 0.0, 1),)
    camera = Orthographic((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (4, 4))
    materials = Material("pane", bsdf=pane or Null()), Material("lamp", emission=(3.0,) * 3)
    return Scene("lamp", camera, materials, shapes, light, "")


SKY = (EnvironmentLight((1.0,) * 3),)


@pytest.mark.parametrize(
    ("pane", "light", "segments", "free"),
    [
        (None, (), 0.0, 0.0),
        (Null(), (), 3.0, 0.0),
        (PANES[-1], (), 1.5, 0.0),
        (None, SKY, 0.0, 0.0),
        (Null(), SKY, 0.0, 0.0),
        (Mixture(kt=(1.0,) * 3), SKY, 1.0, 1.0),
    ],
)
def test_hidden_emitters_are_seen_where_mitsuba_shows_them(pane, light, segments, free):
    """By its `path`, where passing a pane is a segment, and by its `volpath`. Refraction is no null lobe."""
    scene = _seen_through(pane, light)
    for transparent, truth in ((False, segments), (True, free)):
        image = render(scene, spp=16, max_depth=4, hide_emitters=True, transparent_shadows=transparent)
        assert image.mean() == pytest.approx(truth, abs=0.2 if pane is PANES[-1] else 1e-6), transparent


def lamp_before_a_wall(*lights):
    """A lamp of 0.6 m between the camera, which sees 0.5 m, and a wall 1 m behind it."""
    shapes = square(0.0, 0.0, 1.0, 1, half=0.3), square(0.0, 0.0, 0.0, 0, half=2.0)
    camera = Orthographic((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.5, (4, 4))
    lamp = Material("lamp", emission=(3.0,) * 3, two_sided=True)
    return Scene("wall", camera, (Material("wall", kd=(0.5,) * 3), lamp), shapes, lights, "")


def test_hidden_emitters_are_absent_and_light_the_scene():
    """The wall is seen as if the lamp were not there; its light is a quadrature over view and lamp."""
    scene = lamp_before_a_wall()
    options = {"spp": 64, "max_depth": 2, "transparent_shadows": False}
    ours, reference = (render(scene, engine, hide_emitters=True, **options) for engine in ("numba", "numpy"))
    assert ours == pytest.approx(reference, rel=1e-9)
    places = (np.arange(20) + 0.5) / 20 - 0.5
    apart = np.subtract.outer(0.5 * places, 0.6 * places) ** 2
    form = (1.0 / (apart[:, None, :, None] + apart[None, :, None, :] + 1.0) ** 2).mean()
    assert reference.mean() == pytest.approx(3.0 * 0.5 / math.pi * 0.36 * form, rel=0.02)
    assert render(scene, **options) == pytest.approx(3.0)


def test_an_update_without_emitters_hides_nothing():
    """A render that was stopped may have left the flags of lanes that saw the lamp: they are set here."""
    scene = lamp_before_a_wall(EnvironmentLight((1.0, 1.0, 1.0), None))
    settings = Settings(8, 8, shader={"name": "path_tracer", "hide_emitters": True}, sampler="random", precision="float32")
    renderer = engines.engine("numba").prepare(scene, settings)
    renderer.update(shapes=scene.shapes[1:])
    row = 4 * LANES  # bytes of one number a lane
    renderer._memory[0][RayBatch.field("crossing.absent").first * row :][:row] = 1
    fresh = engines.engine("numba").prepare(replace(scene, shapes=scene.shapes[1:]), settings)
    assert np.array_equal(renderer.render(4).sums, fresh.render(4).sums)


@pytest.mark.parametrize("engine", ["numba", "embree"])
def test_rays_end_after_a_thousand_null_lobes(engine):
    """Nothing is seen and nothing is lit through 1,030 null panes in the first column; both are through 1,000."""
    for panes, passes in ((1000, True), (1030, False)):
        heights = 0.3 + 0.3 * np.arange(1, panes + 1) / (panes + 1)
        stack = [square(-2.0, y, z + above, 0) for z in heights for y, above in ((-0.5, 0.0), (0.5, 1.7))]
        upper, lower = _rows(render(_two_rows(stack), engine, "float32", max_depth=2))
        assert lower[0] == pytest.approx(1.0 if passes else 0.0)
        assert upper[0] == pytest.approx(0.5 / math.pi if passes else 0.0, rel=1e-5)
        assert upper[1:] == pytest.approx(0.5 / math.pi * TRANSMITTANCES[1:], rel=1e-5)


def test_rays_of_the_reference_end_after_so_many_null_lobes(monkeypatch):
    """Of two that may be passed, the second ends the path; a shadow ray passes the first, and one that may pass one none."""
    for most, lit in ((2, True), (1, False)):
        for module in (context, numpy_path_tracer):
            monkeypatch.setattr(module, "MOST_NULL_LOBES", most)
        upper, lower = _rows(render(_two_rows(), max_depth=2))
        assert not lower.any()
        assert upper[0] == pytest.approx(0.5 / math.pi if lit else 0.0, rel=1e-5)


# ---- where all comes together ------------------------------------------------------------------------------------------


def _everything():
    """Masks, null, thin panes, a bump around them, blends around each other and sides, between lights and a floor."""
    rng = np.random.default_rng(1)
    height = ImageTexture(rng.uniform(0.0, 1.0, (8, 8, 1)).astype(np.float32))
    holes, leaf = Checkerboard((0.1,) * 3, (0.9,) * 3), Mixture(kd=(0.3, 0.5, 0.2))
    tinted = ThinDielectric(1.5, transmittance=(0.9, 0.7, 0.5))
    bsdfs = (
        Mask(holes, leaf),
        tinted,
        Null(),
        Bump(height, 0.05, Mask(0.5, tinted)),
        Blend(0.4, Blend(holes, Null(), leaf), Mask(0.3, leaf)),
        Sides(Null(), leaf),
    )
    materials = (*(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs)), Material("floor", kd=(0.6, 0.5, 0.4)))
    materials = (*materials, Material("lamp", emission=(6.0, 5.0, 4.0)))
    floor, lamp = len(bsdfs), len(bsdfs) + 1
    shapes = (
        square(0.0, 0.0, 0.0, floor, half=3.0),
        square(-0.8, 0.5, 1.0, 0),
        square(0.8, 0.5, 1.0, 1, rise=0.2),
        Sphere((0.0, 0.0, 0.6), 0.5, 2),
        Sphere((0.0, 0.0, 0.6), 0.2, floor),
        square(-0.8, -0.8, 0.8, 3, rise=0.1),
        square(0.8, -0.8, 1.1, 4),
        square(0.0, 0.9, 1.3, 5),
        Sphere((0.0, 0.0, 2.2), 0.3, lamp),
        Sphere((1.2, -0.2, 1.7), 0.15, lamp),
    )
    lights = PointLight((-1.0, -1.0, 3.0), (1.5, 1.0, 0.5)), EnvironmentLight((0.2, 0.2, 0.3))
    camera = Perspective((0.0, -4.0, 2.2), (0.0, 0.0, 0.7), (0.0, 0.0, 1.0), 50.0, "y", (24, 24))
    return Scene("all that passes", camera, materials, shapes, lights, "")


ALL = {"max_depth": 5, "hide_emitters": True, "light_sampler": "bvh"}


@pytest.mark.parametrize("light_sampler", ["bvh", "spatial"])
@pytest.mark.parametrize("direct", ["mis", "light", "bsdf"])
def test_numba_in_float64_equals_the_reference_behind_null_lobes(direct, light_sampler):
    options = {**ALL, "light_sampler": light_sampler, "direct": direct}
    reference = render(_everything(), spp=2, **options)
    image = render(_everything(), "numba", "float64", spp=2, **options)
    assert reference.mean() > 0.05
    assert np.abs(image - reference).max() < 1e-9 * reference.max()


def test_embree_equals_numba_behind_null_lobes_but_where_rounding_decides():
    """Both draw the same numbers; Embree's hits are rounded to float32. Few of the eight samples of a pixel go another way."""
    ours, other = (render(_everything(), engine, "float64", spp=8, **ALL) for engine in ("numba", "embree"))
    difference = np.abs(ours - other).max(axis=2)
    assert (difference > 1e-4 * ours.max()).mean() < 0.03
    assert other.mean() == pytest.approx(ours.mean(), rel=0.01)


def test_every_strategy_for_direct_light_has_one_mean_behind_null_lobes():
    """By z of the means of 12 seeds, each below 4.5: a false alarm once in 40,000 runs of six comparisons."""
    means = {
        direct: np.array(
            [
                render(_everything(), "numba", "float64", 64, seed, "random", direct=direct, **ALL).mean(axis=(0, 1))
                for seed in range(100 * k, 100 * k + 12)
            ]
        )
        for k, direct in enumerate(("mis", "light", "bsdf"))
    }
    for direct in ("light", "bsdf"):
        apart = means[direct].mean(axis=0) - means["mis"].mean(axis=0)
        error = np.sqrt(sum(m.var(axis=0, ddof=1) / len(m) for m in (means[direct], means["mis"])))
        assert (np.abs(apart) < 4.5 * error).all(), (direct, apart / error)
        assert (error < 0.01 * means["mis"].mean(axis=0)).all()


def test_without_null_lobes_the_option_changes_no_bit():
    scene = engines.load_scene("cornell_box")
    for engine in ("numpy", "numba"):
        shaders = [path_tracer(transparent_shadows=on) for on in (False, True)]
        settings = [Settings(16, 12, shader=shader, seed=3, threads=1) for shader in shaders]
        films = [engines.engine(engine).prepare(scene, chosen).render(2) for chosen in settings]
        assert np.array_equal(films[0].sums, films[1].sums)
