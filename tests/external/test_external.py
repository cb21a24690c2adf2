"""Renderers by process: what is passed to them, what is believed of what they answer, and what is said when they fail."""

import io
import os
import re
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import engines
from engines import Settings
from engines.choices import SHADERS, resolve
from engines.errors import ConfigError, RendererFailed, Unsupported
from engines.peers.external.description import filled
from engines.peers.external.scenes import mitsuba_file, pbrt_file
from engines.scene import CustomLight, HomogeneousMedium
from engines.scene.formats.floats import read_pfm
from tests.external.describing import described
from tests.needs import needs

ROOT = Path(__file__).resolve().parent.parent.parent
MITSUBA = Path(sys.executable).parent / "mitsuba"
SCENE = engines.load_scene("cornell_box")
SETTINGS = Settings(6, 4, sampler="random", seed=5)


def renderer(tmp_path, mode="well", settings=SETTINGS, **changes):
    return engines.engine(str(described(tmp_path, mode, **changes))).prepare(SCENE, settings)


def test_samples_add_up_and_every_call_has_its_own_noise(tmp_path):
    one = renderer(tmp_path)
    first = one.render(4).mean()
    film = one.render(4)
    assert film.spp == 8 and film.mean().shape == (4, 6, 3)
    second = 2 * film.mean() - first
    assert (first != second).all()
    assert film.mean().mean() == pytest.approx(0.5, abs=5 * 0.2 / np.sqrt(8 * 72))
    again = renderer(tmp_path)
    assert (again.render(4).mean() == first).all(), "the seed fixes the image"
    other = renderer(tmp_path, settings=Settings(6, 4, sampler="random", seed=6))
    assert (other.render(4).mean() != first).all()


def test_variance_is_that_between_calls_and_unknown_after_one(tmp_path):
    one = renderer(tmp_path)
    assert np.isnan(one.render(4).variance_of_mean()).all()
    for _ in range(7):
        film = one.render(4)
    assert film.variance_of_mean().mean() == pytest.approx(0.2**2 / 32, rel=0.4)  # 72 values of 7 degrees of freedom
    assert np.isnan(film.half(0)).all(), "nobody knows the halves"


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        ("crash", "a_renderer_crash: the program ended with status 3: the tree fell over"),
        ("signal", "was killed by SIGSEGV"),
        ("silent", "wrote no image"),
        ("garbage", "its image cannot be read: the header of a PFM file is expected"),
        ("size", "its image has 7x4 pixels where 6x4 are expected"),
        ("nan", "1 of the 24 pixels of its image are not finite"),
    ],
)
def test_a_mishap_is_one_sentence_that_names_the_renderer(tmp_path, mode, said):
    with pytest.raises(RendererFailed, match=said) as caught:
        renderer(tmp_path, mode).render(1)
    assert f"a_renderer_{mode}: " in str(caught.value) and "\n" not in str(caught.value)


def test_the_process_is_the_clock_unless_its_words_are(tmp_path):
    timed = renderer(tmp_path)
    start = time.perf_counter()
    timed.render(4)
    assert 0 < timed.counters()["told_seconds"] <= time.perf_counter() - start  # one interval lies in the other
    told = renderer(tmp_path, time={"pattern": r"took (?:(?P<ms>[0-9.]+)ms|(?P<s>[0-9.]+)s)"})
    told.warm_up()
    assert told.counters()["told_seconds"] == 0 and told.film.spp == 0
    told.render(4)
    assert told.counters()["told_seconds"] == 4.0, "the last match counts, in the unit of its group"
    told.render(1)
    assert told.counters()["told_seconds"] == 5.0
    assert (timed.counters()["told_by_program"], told.counters()["told_by_program"]) == (0, 1)
    with pytest.raises(RendererFailed, match="tells no time"):
        renderer(tmp_path, "wordless", time={"pattern": r"took (?P<s>[0-9.]+)s"}).render(1)


def test_stop_kills_the_program_and_the_next_render_runs(tmp_path):
    hanging = renderer(tmp_path, "hang")
    watcher = threading.Timer(0.3, hanging.stop)
    watcher.start()
    assert hanging.render(1).spp == 0  # the program would end well after ten minutes
    with pytest.raises(Unsupported, match="single rays"):
        hanging.trace([[0, 0, 0]], [[0, 0, 1]])


def test_a_long_output_does_not_block_the_program(tmp_path):
    script = "import sys; print('x' * 5_000_000, file=sys.stderr); print('out of paint'); sys.exit(1)"
    said = described(tmp_path, command=["/usr/bin/env", "python3", "-c", script, "{scene}{image}{spp}{seed}"])
    with pytest.raises(RendererFailed, match=r"status 1: out of paint$"):
        engines.engine(str(said)).prepare(SCENE, SETTINGS).render(1)


def test_no_shell_reads_the_command(tmp_path):
    """What a shell would run, split or expand stays one word."""
    word = "$(touch boom); > boom {spp} *"
    said = described(tmp_path, command=["/bin/echo", word, "{{{seed}}}", "{image}"])
    with pytest.raises(RendererFailed, match="wrote no image"):
        engines.engine(str(said)).prepare(SCENE, SETTINGS).render(1)
    assert not list(tmp_path.rglob("boom"))
    assert filled(word, {"spp": 3}) == "$(touch boom); > boom 3 *" and filled("{{{spp}}}", {"spp": 3}) == "{3}"


@pytest.mark.parametrize(
    ("changes", "settings", "said"),
    [
        ({"command": ["no_such_program_at_all", "{spp}{seed}{image}{threads}"]}, {}, "no program 'no_such_program_at_all'"),
        ({"command": ["./missing", "{spp}{seed}{image}{threads}"]}, {}, "no program './missing' at "),
        ({}, {"shader": "whitted"}, "has no shader whitted: its file lists path_tracer, albedo"),
        ({}, {"shader": {"name": "path_tracer", "max_depth": 3}}, "shader path_tracer with max_depth = 16 only"),
        ({}, {"sampler": "sobol"}, "has no sampler sobol"),
        ({}, {"precision": "float64"}, "computes in float32"),
        ({"threads": 1}, {"threads": 2}, "always takes 1 threads"),
    ],
)
def test_what_the_file_does_not_promise_is_declined(tmp_path, changes, settings, said):
    engine = engines.engine(str(described(tmp_path, **changes)))
    asked = Settings(**{"width": 6, "height": 4, "sampler": "random", **settings})
    assert said in (engine.why_not(SCENE, asked) or "")
    with pytest.raises(Unsupported, match="a_renderer_well"):
        engine.prepare(SCENE, asked)


def test_an_option_that_is_passed_may_be_any(tmp_path):
    words = ["/bin/echo", "{shader.max_depth}", "{spp}{seed}{image}"]
    engine = engines.engine(str(described(tmp_path, command=words)))
    deep = Settings(6, 4, sampler="random", shader={"name": "path_tracer", "max_depth": 3})
    assert engine.why_not(SCENE, deep) is None
    flat = Settings(6, 4, sampler="random", shader="albedo")
    assert "{shader.max_depth}, which albedo does not have" in (engine.why_not(SCENE, flat) or "")


def test_the_shipped_example_makes_the_image_of_its_engine(monkeypatch):
    """The sampler `constant` draws the same under every seed, so that pixels can be compared."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    deep = Settings(6, 4, sampler="constant", shader={"name": "path_tracer", "max_depth": 3}, precision="float64")
    external, inside = engines.engine(str(ROOT / "configs/renderers/raybench.yaml")), engines.engine("numpy")
    images = [engine.prepare(SCENE, deep).render(2).mean() for engine in (external, inside)]
    assert np.allclose(*images, rtol=1e-6) and images[0].max() > 0


def test_a_scene_with_plugins_is_declined_where_it_would_be_read(tmp_path):
    lamp = CustomLight(SimpleNamespace(name="lamp", options={}, numpy=print, jitted=print))
    reason = engines.engine(str(described(tmp_path))).why_not(replace(SCENE, lights=(lamp,)), SETTINGS)
    assert reason == "lights[0]: a scene file without code does not support the light plugin 'lamp'"


def test_a_scene_that_is_in_no_file_is_declined_where_it_would_be_read(tmp_path):
    made = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {
                "type": "perspective",
                "eye": [0, 0, 5],
                "target": [0, 0, 0],
                "up": [0, 1, 0],
                "fov": 40,
                "fov_axis": "y",
                "resolution": [8, 8],
            },
        }
    )
    assert "not in a file" in (engines.engine(str(described(tmp_path))).why_not(made, SETTINGS) or "")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"command": "a {scene} {image}"}, "command = 'a {scene} {image}': a list of words is expected: no shell"),
        ({"command": ["a", "{image}{spp}{seed}{sede}"]}, "unknown placeholder {sede}: did you mean 'seed'"),
        ({"command": ["a", "{image}{spp}"]}, "{seed} must occur"),
        ({"command": ["a", "{image}{spp}{seed}}"]}, "a brace stands alone"),
        ({"environment": {"S": "{scene}"}}, "{threads} must occur in it, or the key 'threads'"),
        ({"name": "numpy"}, "is that of an engine"),
        ({"name": "a b"}, "must be letters"),
        ({"shaders": ["path_tracr"]}, "did you mean 'path_tracer'"),
        ({"shaders": []}, "at least one shader"),
        ({"imag": "exr"}, "unknown key: did you mean 'image'"),
        ({"version": None}, "version: is missing"),
        ({"scene_format": "blend"}, "unknown scene format"),
        ({"time": {"pattern": "took (.*)s"}}, "groups named by their unit"),
        ({"time": {"pattern": "took (?P<s>.*"}}, "is no regular expression"),
    ],
)
def test_a_file_that_cannot_be_used_says_where_and_what_is_wanted(tmp_path, changes, said):
    path = described(tmp_path, **changes)
    with pytest.raises(ConfigError) as caught:
        engines.engine(str(path))
    assert said in str(caught.value) and "well.yaml" in str(caught.value)


def test_the_files_content_is_part_of_the_version(tmp_path):
    first = engines.engine(str(described(tmp_path))).version
    second = engines.engine(str(described(tmp_path, image="exr"))).version
    assert first != second and first.startswith("1-")


def test_portable_float_maps_are_read_from_the_bottom_up_in_either_byte_order():
    values = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)
    for order, scale in (("<f4", b"-1.0"), (">f4", b"1.0")):
        image = read_pfm(io.BytesIO(b"PF\n3 2\n" + scale + b"\n" + values[::-1].astype(order).tobytes()))
        assert (image == values).all()
    grey = read_pfm(io.BytesIO(b"Pf 3 2 -1\n" + values[..., 0].astype("<f4").tobytes()))
    assert (grey == values[::-1, :, :1]).all() and grey.shape == (2, 3, 1)
    for bad in (b"", b"P6 1 1 255\nabc", b"PF\n2 2\n-1\n1234", b"PF\n0 0\n-1\n"):
        with pytest.raises(ValueError, match=r"PFM file|cut short"):
            read_pfm(io.BytesIO(bad))


@pytest.mark.parametrize("form", [pytest.param(mitsuba_file, marks=needs("mitsuba-scalar")), pbrt_file])
def test_scenes_with_media_are_exported_with_the_shader_that_renders_them(form, tmp_path):
    fog = HomogeneousMedium("fog", (1.0,) * 3, (0.5,) * 3)
    clear, foggy = SCENE, replace(SCENE, media=(fog,), camera=replace(SCENE.camera, medium=0))
    for scene, shader, integrator in ((clear, "path_tracer", "path"), (foggy, "volumetric_path_tracer", "volpath")):
        settings = Settings(6, 4, shader=resolve("shader", shader, SHADERS))
        text = form(scene, settings, tmp_path).read_text()
        assert re.findall(r'<integrator type="(\w+)"|Integrator "(\w+)"', text) in ([(integrator, "")], [("", integrator)])
    for scene, shader in ((clear, "volumetric_path_tracer"), (foggy, "path_tracer")):
        with pytest.raises(Unsupported, match=f"not with {shader}"):
            form(scene, Settings(6, 4, shader=resolve("shader", shader, SHADERS)), tmp_path)


@needs("mitsuba-scalar")
def test_mitsubas_own_command_makes_the_image_of_ours(monkeypatch):
    """Image means over six processes and six seeds: a false alarm has probability 1e-5 or so."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(MITSUBA.parent), os.environ["PATH"]]))
    means = []
    shader = {"name": "path_tracer", "max_depth": 4}
    for name, precision in ((str(ROOT / "configs/renderers/mitsuba.yaml"), "float32"), ("embreex_batch", "float64")):
        asked = {"sampler": "random", "shader": shader, "precision": precision, "threads": 4}
        renderers = [engines.engine(name).prepare(SCENE, Settings(16, 12, seed=seed, **asked)) for seed in range(6)]
        means.append([renderer.render(128).mean().mean() for renderer in renderers])
        assert len(set(means[-1])) == 6, "every seed has its own noise"
    ours, theirs = np.array(means)
    error = np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 6)
    assert abs(ours.mean() - theirs.mean()) < 8 * error  # Student's t with some 10 degrees of freedom
    assert error < 0.03 * theirs.mean(), "too noisy to see anything"
