"""Calls of one renderer from several threads, and in forked processes (engines.interface.Renderer, engines.concurrency)."""

import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, memory
from engines.concurrency import CallGuard

JITTED = ["numba", "embree"]
PATIENCE = 120.0


def prepared(engine, **settings):
    settings = {"width": 32, "height": 24, "sampler": "random", "threads": 2, **settings}
    return engines.engine(engine).prepare(engines.load_scene("cornell_box"), Settings(**settings))


def rays(n):
    generator = np.random.default_rng(1)
    return generator.uniform(-0.9, 0.9, (n, 3)), generator.normal(size=(n, 3))


class Rendering:
    """A renderer that renders in another thread until the context ends."""

    def __init__(self, renderer):
        self.renderer, self.passes, self.error = renderer, threading.Event(), None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self):
        try:
            self.renderer.render(100_000_000, on_pass=lambda film: self.passes.set())
        except BaseException as error:
            self.error = error

    def __enter__(self):
        self._thread.start()
        assert self.passes.wait(PATIENCE)
        return self

    def __exit__(self, *_):
        self.renderer.stop()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive() and self.error is None


@pytest.mark.parametrize("engine", JITTED)
def test_rays_traced_beside_a_render_are_those_traced_alone_and_leave_the_image_as_it_is(engine):
    renderer, (origins, directions) = prepared(engine), rays(10_000)
    alone, dark = renderer.trace(origins, directions), renderer.occluded(origins, directions, 1.0)
    answers = []

    def ask():
        for n in (10_000, 100, 10_000):
            hits = renderer.trace(origins[:n], directions[:n])
            answers.append((hits, renderer.occluded(origins[:n], directions[:n], 1.0)))

    with Rendering(renderer):
        askers = [threading.Thread(target=ask, daemon=True) for _ in range(2)]
        for thread in askers:
            thread.start()
        for thread in askers:
            thread.join(PATIENCE)
            assert not thread.is_alive()
    assert len(answers) == 6
    for hits, blocked in answers:
        n = len(hits.t)
        assert np.array_equal(hits.t, alone.t[:n]) and np.array_equal(hits.normal, alone.normal[:n])
        assert np.array_equal(blocked, dark[:n])
    done = renderer.film.counts.min()
    same = renderer.film.counts == done
    undisturbed = prepared(engine).render(int(done)).mean()
    assert same.any() and np.array_equal(renderer.film.mean()[same], undisturbed[same])


@pytest.mark.parametrize("engine", JITTED)
def test_what_would_disturb_a_render_is_refused_while_it_runs_and_works_after_it(engine):
    renderer, other = prepared(engine), engines.load_scene("two_spheres")
    with Rendering(renderer):
        for call in (
            lambda: renderer.update(shapes=other.shapes[:1]),
            lambda: renderer.update(camera=other.camera),
            lambda: renderer.render(1),
            renderer.warm_up,
        ):
            with pytest.raises(RuntimeError, match="busy with render"):
                call()
    renderer.update(shapes=other.shapes[:1])
    assert renderer.film.spp == 0 and renderer.render(1).spp == 1


@pytest.mark.parametrize("engine", JITTED)
def test_a_camera_of_another_size_gives_a_film_of_that_size_unless_the_settings_fix_it(engine):
    scene = engines.load_scene("cornell_box")
    camera = replace(scene.camera, resolution=(20, 10))
    free = engines.engine(engine).prepare(scene, Settings(sampler="random", shader="albedo"))
    free.update(camera=camera)
    assert (free.film.width, free.film.height) == (20, 10)
    new = engines.engine(engine).prepare(replace(scene, camera=camera), Settings(sampler="random", shader="albedo"))
    assert np.array_equal(free.render(2).mean(), new.render(2).mean())
    fixed = prepared(engine)
    fixed.update(camera=camera)
    assert (fixed.film.width, fixed.film.height) == (32, 24)


FORK = """
import os, sys, numpy as np, engines
scene = engines.load_scene("cornell_box")
renderer = engines.engine(sys.argv[1]).prepare(scene, engines.Settings(32, 24, sampler="random", threads=2, shader="albedo"))
renderer.render(1)
rays = np.zeros((5000, 3)), np.ones((5000, 3))
before = renderer.trace(*rays)
def child():
    renderer.render(1)
    assert np.array_equal(renderer.trace(*rays).t, before.t)
    renderer.update(shapes=scene.shapes[:4])
    renderer.render(1)
def refused():
    try:
        renderer.render(1)
    except RuntimeError as error:
        assert "was busy at the time" in str(error), error
    else:
        raise SystemExit(3)
def run(job):
    pid = os.fork()
    if pid == 0:
        try:
            job()
        except BaseException as error:
            print(repr(error), flush=True)
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
print(run(child), flush=True)
codes = []
renderer.render(2, on_pass=lambda film: codes.append(run(refused)) if not codes else None)
print(*codes)
assert renderer.film.spp == 3
"""


@pytest.mark.parametrize("engine", JITTED)
def test_a_forked_process_renders_or_is_told_why_not(engine):
    program = [sys.executable, "-c", FORK, engine]
    done = subprocess.run(program, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout.split() == ["0", "0"], done.stdout + done.stderr


def test_an_update_waits_for_rays_and_rays_for_an_update():
    guard, order = CallGuard(), []
    tracing, release = threading.Event(), threading.Event()

    def trace():
        with guard.tracing():
            tracing.set()
            release.wait(PATIENCE)
            order.append("trace")

    def update():
        with guard.updating():
            order.append("update")

    tracer, updater = threading.Thread(target=trace), threading.Thread(target=update)
    tracer.start()
    assert tracing.wait(PATIENCE)
    updater.start()
    updater.join(0.1)
    assert updater.is_alive() and order == []
    release.set()
    for thread in (tracer, updater):
        thread.join(PATIENCE)
    assert order == ["trace", "update"]
    with guard.rendering(), guard.tracing():  # rays may be traced from `on_pass`
        pass


@pytest.mark.parametrize("engine", ["numpy", *JITTED])
def test_a_camera_whose_film_does_not_fit_into_memory_changes_nothing(engine, monkeypatch):
    scene, settings = engines.load_scene("cornell_box"), Settings(sampler="random", shader="albedo")
    small = replace(scene, camera=replace(scene.camera, resolution=(20, 10)))
    renderer = engines.engine(engine).prepare(small, settings)
    before = renderer.render(1).mean().copy()
    monkeypatch.setattr(memory, "limit_bytes", lambda: 1 << 28)
    for changes in ({}, {"shapes": scene.shapes[:3]}):
        with pytest.raises(engines.ConfigError, match="a film of 60000x60000"):
            renderer.update(camera=replace(scene.camera, eye=(0.5, 0, 3), resolution=(60_000, 60_000)), **changes)
    assert np.array_equal(renderer.film.mean(), before)
    twice = engines.engine(engine).prepare(small, settings).render(2).mean()
    assert np.array_equal(renderer.render(1).mean(), twice)
