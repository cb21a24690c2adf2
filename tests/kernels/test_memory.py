"""Kernels stay inside their memory: tables of samples, stacks of rays that wait, tables looked up by numbers that are NaN."""

import gc
import subprocess
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

import engines
from engines import Settings
from engines.kernels import renderer as kernel_renderer
from engines.plugin import Camera, Sampler, ScatterResult, Shader, Vec3, const, inline, select, select3

JITTED = ["numba", "embree"]
ROOT = Path(__file__).resolve().parents[2]


def prepared(engine="numba", scene="two_spheres", **settings):
    scene = engines.load_scene(scene) if isinstance(scene, str) else scene
    settings = {"width": 8, "height": 8, "sampler": "random", **settings}
    return engines.engine(engine).prepare(scene, Settings(**settings))


def test_no_lane_reads_outside_of_the_table_of_samples():
    """Of one engine: the stage that reads it is the same in both."""
    program = [sys.executable, "-m", "tests.kernels.guarded_tables", "numba", "samples"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["halton", "sobol"]), done.stderr


def test_no_lane_of_embree_reads_instances_that_are_gone():
    program = [sys.executable, "-m", "tests.kernels.guarded_tables", "embree", "fewer_instances"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["rendered"]), done.stderr


# ---- shaders that follow two rays from one hit -----------------------------------------------------------------------


def _tree(si, path, depth, second):
    """A step that adds 1 at every vertex and goes on from it until `depth`, in one direction or two, missing nothing."""
    one, zero = const(1.0, si.t), const(0.0, si.t)
    none, ones = Vec3(zero, zero, zero), Vec3(one, one, one)
    goes_on = (path.depth < depth) & (not si.miss)
    shown = select3(si.miss, none, ones)
    infinite = const(np.inf, si.t)
    return ScatterResult(shown, none, goes_on, si.normal, False, ones, infinite, goes_on & second, si.normal, ones)


_tree = inline(_tree)


@inline
def _binary(si, light, bsdf, draws, path, options):
    return _tree(si, path, options[0], True)


def _inside_a_sphere(*more):
    """A camera in a black sphere, from which no ray escapes."""
    camera = {"type": "perspective", "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0], "fov": 40}
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "inside",
            "camera": camera,
            "materials": {"black": {"kd": 0.5}, **dict(more)},
            "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 2}, "material": name} for name in ("black", *dict(more))],
        }
    )


@pytest.mark.parametrize("more", [(), (("mirror", {"ks": 0.9}), ("glass", {"ks": 1, "kt": 1, "fresnel": True}))])
def test_a_plugin_that_branches_follows_every_branch_whatever_the_scene_holds(more):
    shader = Shader("binary", jitted=_binary, options={"depth": 6.0})
    image = prepared(scene=_inside_a_sphere(*more), shader=shader).render(1).mean()
    assert np.array_equal(np.unique(image), [2**6 - 1])


@inline
def _sees_density(si, light, bsdf, draws, path, options):
    """One vertex, two rays; each adds 1 where it comes with a density that is finite, 4 where it is not."""
    one, zero = const(1.0, si.t), const(0.0, si.t)
    none, ones = Vec3(zero, zero, zero), Vec3(one, one, one)
    first = path.depth < const(2.0, si.t)
    shown = select3(first, none, select3(path.pdf < const(np.inf, si.t), ones, ones * const(4.0, si.t)))
    return ScatterResult(shown, none, first, si.normal, False, ones, const(3.0, si.t), first, si.normal, ones)


def test_the_second_ray_of_a_branch_counts_as_specular_and_does_not_have_the_density_of_the_first():
    shader = Shader("density", jitted=_sees_density)
    image = prepared(scene=_inside_a_sphere(), shader=shader).render(1).mean()
    assert np.array_equal(np.unique(image), [1 + 4])


@inline
def _comb(si, light, bsdf, draws, path, options):
    """Goes on to depth options[0] and leaves one ray waiting at every vertex, each of which ends at once."""
    one, zero = const(1.0, si.t), const(0.0, si.t)
    none, ones = Vec3(zero, zero, zero), Vec3(one, one, one)
    first = path.throughput.x > const(0.5, si.t)
    goes_on = first & (path.depth < options[0])
    return ScatterResult(
        ones, none, goes_on, si.normal, False, ones, const(np.inf, si.t), goes_on, si.normal, ones * const(0.25, si.t)
    )


@pytest.mark.parametrize("depth", [40, 200])
def test_more_waiting_rays_than_a_stack_holds_at_first_are_all_followed(depth):
    shader = Shader("comb", jitted=_comb, options={"depth": float(depth)})
    renderer = prepared(scene=_inside_a_sphere(), shader=shader, threads=2)
    assert np.array_equal(np.unique(renderer.render(2).mean()), [2 * depth - 1])


def test_a_shader_that_never_ends_its_branches_is_an_error_in_one_line(monkeypatch):
    monkeypatch.setattr(kernel_renderer, "LARGEST_STACK", 64)
    shader = Shader("endless", jitted=_binary, options={"depth": 1e6})
    renderer = prepared(scene=_inside_a_sphere(), shader=shader)
    with pytest.raises(engines.RaybenchError, match=r"shader 'endless' leaves more than 64 rays waiting"):
        renderer.render(1)


# ---- names and numbers of plugins ------------------------------------------------------------------------------------


@inline
def _light_alone(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    none = Vec3(zero, zero, zero)
    shown = select3(si.miss, none, light.radiance)
    return ScatterResult(shown, none, False, si.direction, False, none, const(np.inf, si.t), False, none, none)


@pytest.mark.parametrize("name", ["albedo", "depth_map", "no_shadows", "whitted", "path_tracer"])
def test_a_plugin_shader_is_given_lights_whatever_it_is_called(name):
    image = prepared(shader=Shader(name, jitted=_light_alone)).render(1).mean()
    assert np.array_equal(image, prepared(shader=Shader("other", jitted=_light_alone)).render(1).mean())
    assert image.max() > 0


@inline
def _half(pixel, sample, dimension, seed):
    return 0.5


@pytest.mark.parametrize("name", ["sobol", "halton", "stratified", "constant", "random"])
def test_a_plugin_sampler_may_be_called_like_a_built_in_one(name):
    own = prepared(sampler=Sampler(name, jitted=_half)).render(1).mean()
    assert np.array_equal(own, prepared(sampler={"name": "constant", "value": 0.5}).render(1).mean())


@inline
def _nowhere(x, y, width, height, options):
    return 0.0, 0.0, 0.0, np.nan, np.nan, np.nan


@inline
def _wild(pixel, sample, dimension, seed):
    k = (sample + dimension) % 4
    return select(k == 0, np.nan, select(k == 1, -1e9, select(k == 2, 1e30, np.inf)))


def _lit_by_an_image(camera):
    image = np.linspace(0, 1, 8 * 4 * 3).reshape(4, 8, 3)
    lights = [{"environment": {"radiance": 1}}, {"point": {"position": [0, 3, 0], "intensity": 1}}]
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "image",
            "camera": camera,
            "materials": {"white": {"kd": 0.5}},
            "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "white"}],
            "lights": lights,
        },
        allow_imports=True,
    )
    from dataclasses import replace

    return replace(scene, lights=(replace(scene.lights[0], image=image), *scene.lights[1:]))


@pytest.mark.parametrize("engine", JITTED)
def test_numbers_of_plugins_that_are_not_finite_lead_to_no_memory_of_others(engine):
    scene = _lit_by_an_image({"type": Camera("nowhere", jitted=_nowhere)})
    film = prepared(engine, scene).render(2)
    assert np.isfinite(film.mean()).all()
    eye = {"type": "perspective", "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40}
    film = prepared(engine, _lit_by_an_image(eye), sampler=Sampler("wild", jitted=_wild)).render(8)
    assert np.isfinite(film.mean()).all()


# ---- memory outside of Python ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", JITTED)
def test_a_renderer_whose_code_is_compiled_and_its_tree_are_freed_without_the_cyclic_collector(engine):
    # Numba keeps exceptions in cycles, and these keep the frames of all that has called it: the compiling renderer is another.
    first = prepared(engine, "cornell_box", threads=2)
    first.warm_up()
    first.trace(np.zeros((5000, 3)), np.ones((5000, 3)))
    del first
    gc.collect()
    gc.disable()
    try:
        renderer = prepared(engine, "cornell_box", threads=2)
        renderer.warm_up()
        renderer.render(1)
        renderer.trace(np.zeros((5000, 3)), np.ones((5000, 3)))
        owned = [weakref.ref(thing) for thing in renderer._flat.owned]
        gone = weakref.ref(renderer)
        renderer.update(shapes=engines.load_scene("two_spheres").shapes[:1])
        assert [thing() for thing in owned] == [None] * len(owned)
        del renderer
        patience = time.monotonic() + 60  # a thread may still be putting its last piece of work away
        while gone() is not None and time.monotonic() < patience:
            time.sleep(0.01)
        assert gone() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("engine", JITTED)
def test_an_update_that_fails_leaves_the_renderer_as_it_was(engine, monkeypatch):
    renderer, scene = prepared(engine, "cornell_box"), engines.load_scene("two_spheres")
    before = renderer.render(2).mean()
    monkeypatch.setattr(renderer._accelerator, "build", lambda flat, threads: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        renderer.update(camera=scene.camera, shapes=scene.shapes[:1])
    assert np.array_equal(renderer.film.mean(), before)
    assert np.array_equal(renderer.render(2).mean(), prepared(engine, "cornell_box").render(4).mean())
