"""An engine in a process of its own: the same images and errors as in this one, and no process that hangs or is left."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import engines
from engines import ConfigError, Settings, Unsupported
from engines.conformance import concurrency, rendering
from engines.conformance.subject import Subject
from engines.errors import RendererFailed, UnknownName
from engines.interface import HasTracer
from engines.processes.pickled import dumped, loaded
from tests.isolated.environments import environment
from tests.isolated.renderers import FOREIGN, KILLED, REPLACED, SLEEPING
from tests.needs import needs

ROOT = Path(__file__).resolve().parents[2]
APART = "tests.isolated.renderers:Apart"
LANTERN = "tests.isolated.renderers:Lantern"
CLAIMS = (
    rendering.stop_in_a_callback_ends_the_render,
    rendering.stop_from_a_thread_ends_the_render,
    rendering.stop_at_rest_does_nothing,
    rendering.update_of_the_shapes_starts_anew,
    rendering.film_has_the_size_asked_for,
    concurrency.a_render_is_not_disturbed,
    concurrency.rays_beside_a_render_are_answered_as_alone,
    concurrency.update_takes_the_size_of_the_camera,
)


@pytest.fixture(scope="module")
def apart():
    return engines.engine(APART)


@pytest.fixture(scope="module")
def scene():
    return engines.load_scene(ROOT / "scenes" / "cornell_box.yaml")


def settings(depth=4, size=(12, 8), **more):
    return Settings(*size, shader={"name": "path_tracer", "max_depth": depth}, sampler="random", seed=5, **more)


def test_the_image_is_that_of_the_engine_in_this_process(apart, scene):
    ours, theirs = (engine.prepare(scene, settings()).render(3) for engine in (engines.engine("numpy"), apart))
    assert apart.version != f"1+{os.getpid()}"
    for part in ("sums", "squares", "even_sums", "counts"):
        assert np.array_equal(getattr(ours, part), getattr(theirs, part))


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.__name__)
def test_claims_about_calls_from_threads_and_callbacks_hold(apart, claim):
    with Subject(apart) as subject:
        claim(subject)


def test_an_engine_that_only_traces_does_so_there(scene):
    alone = engines.engine("tests.isolated.renderers:RaysAlone")
    assert isinstance(alone, HasTracer) and not isinstance(engines.engine(APART), HasTracer)
    assert alone.why_not_tracer(scene, settings()) is None
    refused = alone.why_not_tracer(replace(scene, shapes=()), settings())
    assert refused and not refused.endswith(str(os.getpid()))
    rays = np.zeros((3, 3)), np.array([[0, 0, -1.0], [0, 1, 0], [1, 1, 1]])
    ours, theirs = (
        made.trace(*rays) for made in (engines.engine("numpy").prepare(scene, settings()), alone.tracer(scene, settings()))
    )
    assert np.array_equal(ours.t, theirs.t) and np.array_equal(ours.shape, theirs.shape)


def test_an_array_that_the_engine_replaces_is_copied(apart, scene):
    film = apart.prepare(scene, settings(REPLACED)).render(2)
    same = engines.engine("numpy").prepare(scene, settings(REPLACED)).render(2)
    assert np.array_equal(film.sums, same.sums) and np.isnan(film.squares).all()


def test_errors_come_back_as_they_are_and_others_as_one_line(apart, scene):
    with pytest.raises(UnknownName, match="did you mean 'random'"):
        apart.prepare(scene, Settings(sampler="randm"))
    with pytest.raises(ConfigError, match="max_depth"):
        apart.why_not(scene, settings(0))
    renderer = apart.prepare(scene, settings(FOREIGN))
    with pytest.raises(RendererFailed) as caught:
        renderer.render(1)
    assert str(caught.value) == "ForeignError: two\\nlines"
    with pytest.raises(ZeroDivisionError):
        apart.prepare(scene, settings()).render(1, lambda film: 1 / 0)


def test_what_cannot_be_sent_is_declined(apart, scene):
    class Plugin:
        name = "here alone"

    with pytest.raises(Unsupported, match="runs in a process of its own, to which this cannot be sent"):
        apart.why_not(scene, Settings(sampler=Plugin()))
    assert apart.why_not(scene, settings()) is None


def test_a_crash_is_told_with_signal_and_last_words_and_the_next_renderer_works(apart, scene):
    renderer = apart.prepare(scene, settings(KILLED))
    for _ in range(2):
        with pytest.raises(RendererFailed, match="apart: its process was killed by SIGSEGV: the last words"):
            renderer.render(1)
    renderer.stop()
    assert apart.prepare(scene, settings()).render(1).spp == 1


def test_renderers_have_processes_of_their_own_which_are_used_again(scene):
    apart = engines.engine(APART)  # with processes of its own: renderers of other tests may give theirs back at any time

    def process(renderer):
        return renderer._process._process.pid

    one, other = (apart.prepare(scene, settings()) for _ in range(2))
    used = {process(one), process(other)}
    assert len(used) == 2
    del one, other
    assert process(apart.prepare(scene, settings())) in used


SCRIPT = f"""
import sys, engines
from engines import Settings
scene = engines.load_scene({str(ROOT / "scenes" / "cornell_box.yaml")!r})
engine = engines.engine({APART!r})
shader = {{"name": "path_tracer", "max_depth": {SLEEPING}}}
renderer = engine.prepare(scene, Settings(8, 8, shader=shader, sampler="random"))
print(renderer._process._process.pid, flush=True)
if sys.argv[1] == "render":
    renderer.render(1)
"""


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@needs("linux")
@pytest.mark.parametrize("when", ["rest", "render"])
def test_no_process_is_left_behind_by_one_that_ends_or_is_killed(when):
    parent = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, when], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    child = int(parent.stdout.readline())
    if when == "render":
        assert parent.stderr.readline() == "asleep\n"
        assert alive(child)
        parent.send_signal(signal.SIGKILL)
    parent.wait(20)
    until = time.monotonic() + 20
    while alive(child) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(child)
    parent.stdout.close()
    parent.stderr.close()


def test_an_engine_runs_with_the_python_of_another_environment(tmp_path, scene):
    made = [engines.engine(f"{LANTERN}@{environment(tmp_path / name, name)}") for name in ("1.0", "2.0")]
    assert [engine.version for engine in made] == ["4+1.0", "4+2.0"]
    assert [engine.environment["lantern"] for engine in made] == ["1.0", "2.0"]
    assert made[0].environment["files"] != "" and made[0].environment["numpy"] == np.__version__
    assert [engine.why_not(scene, settings()) for engine in made] == [None, None]
    here = engines.engine(LANTERN)
    assert here.why_not(scene, settings()) == "the package lantern is not installed"


@pytest.mark.parametrize(
    ("python", "wanted"),
    [
        ("{}/none", "none: does not exist: the folder of a virtual environment, or a Python, is expected"),
        ("{}", "there is no bin/python in it: the folder of a virtual environment is expected"),
        ("{}/text", "text: is no program: the folder of a virtual environment, or a Python, is expected"),
        ("{}/program", "program: cannot run the engine numpy: numpy: its process ended with status 3: no Python"),
        ("{}/empty", "cannot run the engine numpy: numpy: its process ended with status 1: ModuleNotFoundError: No module"),
    ],
)
def test_a_python_that_cannot_run_an_engine_is_refused_in_one_line(tmp_path, python, wanted):
    import venv

    (tmp_path / "text").write_text("")
    (tmp_path / "program").write_text("#!/bin/sh\necho no Python\nexit 3\n")
    (tmp_path / "program").chmod(0o755)
    if python.endswith("empty"):
        venv.create(tmp_path / "empty", symlinks=True, with_pip=False)
    with pytest.raises(ConfigError) as caught:
        assert engines.engine("numpy@" + python.format(tmp_path)).version
    assert wanted in str(caught.value)


def test_an_environment_may_be_named_by_a_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_APART_PYTHON", str(tmp_path / "none"))
    with pytest.raises(ConfigError, match="none: does not exist"):
        engines.engine(APART)


def test_arrays_and_numbers_of_any_kind_travel(scene):
    large = np.arange(50_000, dtype=np.float32).reshape(5, -1)
    large.flags.writeable = False
    message = [large, large.copy()[:, ::2], np.zeros((0, 3)), np.array(3.5), np.float32(2.5), np.array([True]), "text", None]
    data, beside = dumped(message)
    found = loaded(data, [bytearray(each) for each in beside])
    assert len(beside) == 2 and sum(each.nbytes for each in beside) == 300_000
    for one, other in zip(message, found, strict=True):
        assert type(one) is type(other) and np.array_equal(one, other)
    assert not found[0].flags.writeable and found[1].flags.writeable and found[3].shape == ()
    assert found[4].dtype == np.float32
