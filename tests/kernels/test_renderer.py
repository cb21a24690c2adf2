"""What the jitted engines promise beyond `engines.conformance`: plugins, caches, stopping, changing scenes."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.kernels.compile.code_cache import cache_folder
from engines.plugin import Camera, Sampler, Shader, Vec3, const, finish, inline, select3

JITTED = ["numba", "embree"]


def _renderer(engine="numba", scene="cornell_box", **settings):
    settings = {"width": 40, "height": 30, "shader": "path_tracer", "sampler": "sobol", **settings}
    return engines.engine(engine).prepare(engines.load_scene(scene), Settings(**settings))


@inline
def _normals(si, light, bsdf, draws, path, options):
    zero, half = const(0.0, si.t), const(0.5, si.t)
    none = Vec3(zero, zero, zero)
    colour = (si.normal + Vec3(const(1.0, half), const(1.0, half), const(1.0, half))) * half * options[0]
    return finish(si.t, select3(si.miss, none, colour), none)


@pytest.mark.parametrize("engine", JITTED)
def test_a_shader_of_ones_own_runs_in_the_same_lanes(engine):
    shader = Shader("normals", jitted=_normals, options={"brightness": 2.0})
    image = _renderer(engine, shader=shader, sampler="constant").render(1).mean()
    settings = Settings(40, 30, shader="albedo", sampler="constant")
    renderer = engines.engine("numba").prepare(engines.load_scene("cornell_box"), settings)
    x, y = 0.5, 0.5  # the ray of the middle of the image
    h = np.tan(np.radians(39.3077) / 2)
    direction = [h * 40 / 30 * (2 * (20 + x) / 40 - 1), h * (1 - 2 * (15 + y) / 30), -1.0]
    normal = renderer.trace([[0.0, 0.0, 3.9]], [direction]).normal[0]
    assert image[15, 20] == pytest.approx(2 * (normal + 1) / 2, abs=1e-5)
    assert image.std() > 0.1


@inline
def _density_of_emission(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    return finish(si.t, Vec3(si.light_pdf, si.light_pdf, si.light_pdf), Vec3(zero, zero, zero))


@pytest.mark.parametrize("engine", JITTED)
def test_the_density_of_emission_counts_the_choice_of_a_light_only_where_one_is_chosen(engine):
    lamps = [{"sphere": {"center": [x, 0, -3], "radius": 0.5}, "material": "lamp"} for x in (-1, 0, 1)]
    scene = {
        "raybench_scene": 1,
        "name": "three lamps",
        "camera": {"type": "perspective", "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0], "fov": 60},
        "materials": {"lamp": {"emission": [1, 1, 1]}},
        "shapes": lamps,
    }
    one, every = (
        engines.engine(engine)
        .prepare(
            engines.scene_from(scene),
            Settings(32, 24, shader=Shader("density", jitted=_density_of_emission, lights=lights), sampler="constant"),
        )
        .render(1)
        .mean()[..., 0]
        for lights in ("one", "all")
    )
    assert (one > 0).any()
    assert every == pytest.approx(3 * one, rel=1e-5)


@inline
def _always_a_quarter(pixel, sample, dimension, seed):
    return 0.25


def test_a_sampler_of_ones_own_equals_the_built_in_that_does_the_same():
    own = _renderer(sampler=Sampler("quarter", jitted=_always_a_quarter)).render(1).mean()
    built_in = _renderer(sampler={"name": "constant", "value": 0.25}).render(1).mean()
    assert np.array_equal(own, built_in)


@inline
def _window(x, y, width, height, options):
    return (2 * x / width - 1) * options[0], 1 - 2 * y / height, 3.0, 0.0, 0.0, -1.0


def test_a_camera_of_ones_own_sees_what_it_is_told():
    scene = {
        "raybench_scene": 1,
        "name": "window",
        "camera": {"type": Camera("window", jitted=_window), "scale": 1.0},
        "materials": {"red": {"kd": [0.5, 0, 0]}},
        "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 0.5}, "material": "red"}],
    }
    scene = engines.scene_from(scene, allow_imports=True)
    settings = Settings(64, 64, shader="albedo", sampler="constant")
    image = engines.engine("numba").prepare(scene, settings).render(1).mean()[..., 0]
    assert (image > 0).mean() == pytest.approx(np.pi / 16, abs=0.01)


def test_a_plugin_without_a_jitted_function_is_declined_in_a_sentence():
    settings = Settings(8, 8, shader=Shader("only numpy", numpy=lambda *_: None))
    scene = engines.load_scene("cornell_box")
    sentence = engines.engine("numba").why_not(scene, settings)
    assert sentence is not None
    assert "only numpy" in sentence and "jitted" in sentence
    with pytest.raises(Unsupported, match="only numpy"):
        engines.engine("numba").prepare(scene, settings)


@pytest.mark.parametrize("engine", JITTED)
def test_stop_from_another_thread_ends_a_long_render_within_a_fifth_of_a_second(engine):
    """Of CPU time in each of two threads: a busy machine lets them wait."""
    renderer = _renderer(engine, width=256, height=256, threads=2)
    renderer.render(1)
    called = []

    def stop():
        begin = time.process_time()
        while time.process_time() < begin + 0.3:
            time.sleep(0.01)
        called.append(time.process_time())
        renderer.stop()

    thread = threading.Thread(target=stop)
    thread.start()
    film = renderer.render(1_000_000)
    assert time.process_time() - called[0] < 2 * 0.2
    thread.join()
    assert film.spp >= 1 and np.isfinite(film.mean()).all()


@pytest.mark.parametrize("engine", JITTED)
def test_a_render_that_goes_on_after_a_stop_ends_with_the_undisturbed_image(engine):
    renderer = _renderer(engine, width=96, height=80, threads=2)
    threading.Timer(0.05, renderer.stop).start()
    renderer.render(100_000)
    target = renderer.film.spp + 3
    stopped = renderer.render(3).mean()
    here = renderer.film.counts == target  # tiles that had run ahead hold more samples
    undisturbed = _renderer(engine, width=96, height=80).render(target).mean()
    assert here.any() and np.array_equal(stopped[here], undisturbed[here])
    assert renderer.film.spp == target


@pytest.mark.parametrize("engine", JITTED)
def test_a_moved_camera_and_changed_shapes_give_the_image_of_a_new_renderer(engine):
    import dataclasses

    box, other = engines.load_scene("cornell_box"), engines.load_scene("cornell_spheres")
    renderer = _renderer(engine)
    renderer.render(2)
    camera = dataclasses.replace(box.camera, eye=(0.2, 0.1, 3.5))
    renderer.update(camera=camera)
    moved = engines.engine(engine).prepare(dataclasses.replace(box, camera=camera), renderer.settings).render(2).mean()
    assert np.array_equal(renderer.render(2).mean(), moved)
    shapes = (*box.shapes[:-2], dataclasses.replace(other.shapes[0], material=0))
    renderer.update(shapes=shapes)
    scene = dataclasses.replace(box, camera=camera, shapes=shapes)
    changed = engines.engine(engine).prepare(scene, renderer.settings).render(2).mean()
    assert np.array_equal(renderer.render(2).mean(), changed)


def test_built_in_combinations_come_from_the_disk_cache_in_a_second_process():
    code = (
        "import engines\n"
        "settings = engines.Settings(8, 8, shader='albedo', sampler='random', precision='float32')\n"
        "r = engines.engine('numba').prepare(engines.load_scene('cornell_box'), settings)\n"
        "r.warm_up(); r.render(1); print(*(stage.cache_hits for stage in r._kept))\n"
    )

    def run():
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()

    run()  # compiles what no other test has yet
    assert set(run()) == {"1"}


def test_machine_code_of_versions_that_nobody_has_used_for_a_month_is_removed(tmp_path):
    for name, days in (("kernels-old", 31), ("kernels-young", 29), ("other-old", 31)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "code.nbc").write_bytes(b"0")
        then = time.time() - days * 86_400
        os.utime(tmp_path / name, (then, then))
    code = "import engines; engines.engine('numba')"
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}, check=True)
    assert {path.name for path in tmp_path.iterdir()} - {cache_folder().name} == {"kernels-young", "other-old"}


def test_samples_that_are_not_finite_are_black_and_counted():
    @inline
    def broken(si, light, bsdf, draws, path, options):
        nan = const(np.nan, si.t)
        return finish(si.t, Vec3(nan, nan, nan), Vec3(nan - nan, nan - nan, nan - nan))

    renderer = _renderer(shader=Shader("broken", jitted=broken))
    film = renderer.render(2)
    assert not film.mean().any()
    assert film.bad_samples == renderer.counters()["bad_samples"] == 2 * 40 * 30


def test_a_scene_without_shapes_or_lights_is_black():
    camera = {"type": "perspective", "eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0]}
    empty = engines.scene_from({"raybench_scene": 1, "name": "empty", "camera": camera, "shapes": []})
    for engine, shader in (("numba", "path_tracer"), ("numba", "whitted"), ("numba", "depth_map"), ("embree", "path_tracer")):
        renderer = engines.engine(engine).prepare(empty, Settings(8, 8, shader=shader, precision="float64"))
        assert not renderer.render(2).mean().any()
        assert np.isinf(renderer.trace([[0, 0, 1.0]], [[0, 0, -1.0]]).t).all()


def test_a_missing_embree_library_is_named(monkeypatch):
    from engines.embree import library

    monkeypatch.setattr(library.metadata, "files", lambda name: [])
    library.library.cache_clear()
    try:
        with pytest.raises(Unsupported, match="libembree4"):
            engines.engine("embree").prepare(engines.load_scene("cornell_box"), Settings(8, 8))
    finally:
        library.library.cache_clear()


def test_an_interrupt_stops_the_threads_and_leaves_a_renderer_that_works():
    code = (
        "import engines, signal, threading, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background jobs ignore it
        "s = engines.Settings(128, 128, shader='albedo', sampler='random', threads=2)\n"
        "r = engines.engine('numba').prepare(engines.load_scene('cornell_box'), s); r.warm_up()\n"
        "threading.Timer(0.4, lambda: signal.raise_signal(signal.SIGINT)).start()\n"
        "try:\n    r.render(10_000_000)\nexcept KeyboardInterrupt:\n    before = int(r.film.counts.max())\n"
        "time.sleep(0.2); assert int(r.film.counts.max()) == before\n"
        "spp = r.film.spp; assert r.render(2).spp == spp + 2; print('well')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout == "well\n", done.stderr
