"""The engines against each other: equal to rounding where they share arithmetic, statistically elsewhere."""

import warnings

import numpy as np
import pytest
from scipy import stats

import engines
from engines import Settings

SHADERS = ["path_tracer", "whitted", "no_shadows", "depth_map", "albedo"]
SAMPLERS = ["constant", "stratified", "halton", "random"]
FALSE_ALARM = 2e-5
SCENES = ["cornell_box", "two_spheres", "cornell_spheres", "furnace"]


def _image(engine, scene, spp=2, **settings):
    renderer = engines.engine(engine).prepare(scene, Settings(**{"width": 48, "height": 36, "seed": 3, **settings}))
    return renderer.render(spp).mean()


def _differing(a, b):
    """Share of pixels that differ by more than 1e-9 relative."""
    scale = np.maximum(np.abs(a).max(axis=2), 1e-12)
    return np.mean(np.abs(a - b).max(axis=2) / scale > 1e-9)


def _assert_equal(scene, accelerators, **settings):
    """Equal to 1e-9 on all but edge pixels: fewer than one in a thousand, or one pixel of a small image."""
    reference = _image("numpy", scene, **settings)
    allowed = max(1e-3, 1.0 / reference[..., 0].size)
    for accelerator in accelerators:
        image = _image("numba", scene, precision="float64", accelerator=accelerator, **settings)
        assert _differing(reference, image) <= allowed, accelerator


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("name", SCENES)
def test_numba_in_float64_equals_the_reference_on_every_scene_with_every_shader(name, shader):
    _assert_equal(engines.load_scene(name), ["none"], shader=shader, sampler="sobol")


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_numba_in_float64_equals_the_reference_with_every_sampler(sampler):
    _assert_equal(engines.load_scene("two_spheres"), ["none"], shader="path_tracer", sampler=sampler, spp=5)


@pytest.mark.parametrize("direct", ["light", "bsdf", "mis"])
def test_numba_in_float64_equals_the_reference_with_every_strategy_for_direct_light(direct):
    shader = {"name": "path_tracer", "direct": direct, "max_depth": 5, "rr_depth": 2}
    _assert_equal(engines.load_scene("cornell_spheres"), ["bvh"], shader=shader, sampler="sobol")


def test_numba_in_float64_equals_the_reference_in_large_meshes():
    _assert_equal(engines.load_scene("mesh_sphere"), ["bvh", "grid"], shader="path_tracer", sampler="sobol")


def _everything():
    """All shapes, materials and lights in one scene, with an environment image."""
    return {
        "raybench_scene": 1,
        "name": "everything",
        "camera": {"type": "orthographic", "eye": [0, 2, 8], "target": [0, 1, 0], "up": [0, 1, 0], "height": 4},
        "materials": {
            "floor": {"kd": [0.6, 0.5, 0.4]},
            "coat": {"kd": 0.4, "ks": 0.5, "ior": 1.4, "fresnel": True},
            "mirror": {"ks": 0.9},
            "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
            "gel": {"kt": 0.7, "ks": 0.2, "ior": 1.2},
            "lamp": {"emission": [6, 5, 4]},
            "glow": {"emission": [1, 2, 3], "two_sided": True, "kd": 0.2},
        },
        "shapes": [
            {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "floor"},
            {"sphere": {"center": [-1.5, 0.7, 0], "radius": 0.7}, "material": "glass"},
            {"sphere": {"center": [0, 0.5, 1], "radius": 0.5}, "material": "mirror"},
            {"sphere": {"center": [1.5, 0.6, 0], "radius": 0.6}, "material": "coat"},
            {"sphere": {"center": [0.3, 1.9, -1], "radius": 0.4}, "material": "gel"},
            {"sphere": {"center": [-0.8, 2.4, 0], "radius": 0.2}, "material": "lamp"},
            {"procedural": {"name": "sphereflake", "level": 2}, "material": "coat"},
            {"triangle": {"a": [-2, 3.5, -1], "b": [-1, 3.5, 1], "c": [0, 3.5, -1]}, "material": "glow"},
            {
                "procedural": {"name": "tessellated_sphere", "subdivisions": 2, "center": [1.9, 1.8, 0], "radius": 0.4},
                "material": "floor",
            },
        ],
        "lights": [
            {"point": {"position": [0, 3, 3], "intensity": [3, 2, 1]}},
            {"directional": {"direction": [1, -2, -1], "irradiance": 0.4}},
            {"environment": {"radiance": [0.2, 0.3, 0.4]}},
        ],
    }


@pytest.mark.parametrize("shader", ["path_tracer", "whitted"])
def test_numba_in_float64_equals_the_reference_where_everything_comes_together(shader):
    _assert_equal(engines.scene_from(_everything()), ["none", "bvh"], shader=shader, sampler="sobol")


def test_numba_in_float64_equals_the_reference_under_an_image_of_the_sky(tmp_path):
    from engines.image import write_image

    rows, columns = np.mgrid[0:16, 0:32]
    texels = np.stack([0.1 + rows / 40, 0.2 + columns / 80, 0.3 + 8.0 * ((rows == 4) & (columns == 9))], axis=-1)
    write_image(tmp_path / "environment.exr", texels, {})
    scene = {**_everything(), "lights": [{"environment": {"image": "environment.exr", "radiance": [1, 0.8, 0.6]}}]}
    _assert_equal(engines.scene_from(scene, folder=tmp_path), ["bvh"], shader="path_tracer", sampler="random")


# ---- where arithmetic differs ---------------------------------------------------------------------------------------


def _replicates(engine, scene, seeds, **settings):
    images = [_image(engine, scene, 8, seed=seed, sampler="random", width=24, height=24, **settings) for seed in seeds]
    return np.stack(images)


CHEAP = ("two_spheres", "cornell_spheres")
"""Their materials and lights are those of all four."""
OTHERS = [
    pytest.param(engine, precision, name, marks=() if name in CHEAP and precision == "float32" else pytest.mark.slow)
    for engine, precision in (("numba", "float32"), ("embree", "float32"), ("embree", "float64"))
    for name in SCENES
]


@pytest.mark.parametrize(("engine", "precision", "name"), OTHERS)
def test_engines_of_other_arithmetic_agree_statistically(name, engine, precision):
    """Welch's test a pixel with Sidak's correction, and one on image means, each with a false alarm in 1 of 50,000 draws:
    together the 24 have one in 5 of 10,000."""
    scene = engines.load_scene(name)
    ours = _replicates(engine, scene, range(100, 124), precision=precision)
    theirs = _replicates("numba", scene, range(200, 224), precision="float64")
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings(action="ignore"):
        p = stats.ttest_ind(ours, theirs, axis=0, equal_var=False).pvalue
    # pixels without noise (the environment) differ by float32's rounding of their constant, eps32 relative
    rounding = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) <= np.finfo(np.float32).eps * theirs.mean(axis=0)
    p = np.where(np.isnan(p) | rounding, 1.0, p)
    assert p.min() > 1 - (1 - FALSE_ALARM) ** (1 / p.size)
    means = ours.mean(axis=(1, 2, 3)), theirs.mean(axis=(1, 2, 3))
    error = np.hypot(*(m.std(ddof=1) / np.sqrt(len(m)) for m in means))
    far = stats.t.isf(FALSE_ALARM / 2, 2 * len(ours) - 2)
    assert abs(means[0].mean() - means[1].mean()) < far * error + 1e-6


@pytest.mark.parametrize("engine", ["numba", "embree"])
def test_the_closed_furnace_is_one(engine):
    """numpy's is exact: tests/numpy_reference/test_known_answers.py."""
    settings = Settings(24, 24, shader="path_tracer", sampler="sobol", threads=2)
    film = engines.engine(engine).prepare(engines.load_scene("furnace"), settings)
    assert film.render(256).mean().mean() == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("engine", ["numba", "embree"])
def test_threads_and_the_splitting_of_calls_change_no_bit(engine):
    scene = engines.load_scene("two_spheres")
    whole = None
    for threads, split in ((1, [9]), (2, [4, 5]), (4, [1, 1, 7])):
        settings = Settings(70, 50, shader="path_tracer", sampler="sobol", threads=threads, seed=5)
        renderer = engines.engine(engine).prepare(scene, settings)
        for spp in split:
            film = renderer.render(spp)
        image = np.stack([film.sums, film.squares, film.even_sums])
        assert whole is None or np.array_equal(image, whole)
        whole = image


def test_numba_in_float64_equals_the_reference_on_smooth_mirrors_and_glass():
    materials = {"glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True}, "mirror": {"ks": 0.9}}
    corners = np.array([*np.eye(3), *-np.eye(3)])  # an octahedron as coarse as can be
    faces = [[a, b, c] for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    faces = [f if sum(x > 2 for x in f) % 2 == 0 else [f[0], f[2], f[1]] for f in faces]
    glass, mirror = ({"vertices": corners + np.array([x, 1, 0]), "faces": faces, "smooth": True} for x in (-1.2, 1.2))
    scene = engines.scene_from(
        {
            **_everything(),
            "materials": {**materials, "floor": {"kd": 0.5}},
            "shapes": [
                {"mesh": glass, "material": "glass"},
                {"mesh": mirror, "material": "mirror"},
                {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "floor"},
            ],
        }
    )
    for shader in ("path_tracer", "whitted"):
        _assert_equal(scene, ["bvh"], shader=shader, sampler="sobol")


@pytest.mark.parametrize(("scene", "shader"), [("two_spheres", "whitted"), ("cornell_spheres", "path_tracer")])
def test_rays_are_counted_alike(scene, shader):
    """The engines draw the same numbers, so they trace the same rays but for those that rounding sends elsewhere: embree
    finds its hits in float32."""
    counted = {}
    for engine in ("numpy", "numba", "embree"):
        settings = Settings(48, 36, shader=shader, sampler="random", precision="float64", threads=2)
        renderer = engines.engine(engine).prepare(engines.load_scene(scene), settings)
        renderer.warm_up()
        assert renderer.counters()["rays"] == 0
        renderer.render(2)
        counted[engine] = renderer.counters()["rays"]
        renderer.trace(np.zeros((5000, 3)), np.ones((5000, 3)))
        renderer.occluded([[0, 0, 0], [0, 0, 0], [0, 0, 0]], [[0, 0, 1], [0, 0, 0], [0, 1, 0]], [1, 1, -1])
        assert renderer.counters()["rays"] == counted[engine] + 5001
    assert counted["numba"] == pytest.approx(counted["numpy"], rel=1e-3)
    assert counted["embree"] == pytest.approx(counted["numpy"], rel=2e-3)
