"""Shaders, samplers and accelerators of the user's with options: from a config beside them, the command line and Python."""

import sys
from pathlib import Path

import numpy as np
import pytest

import engines
from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, UnknownName
from engines.imports import imported
from harness import config, store
from harness.plan import planner
from harness.settings import CellSettings, completed, engine_settings, plugin_or_choice
from tests.harness import sweeping

CODE = '''
CODE = "text"
import numpy as np

from engines import choices
from engines.film import Film
from engines.plugin import Sampler, Shader

def shown(context, origins, directions, pixels, sample):
    """Grey: the shader's strength times the sampler's first draw."""
    return context.options["strength"] * np.repeat(context.draw(pixels, sample, 0)[:, None], 3, axis=1)

def draws(pixels, sample, dimension, seed, options):
    return np.full(pixels.shape, int(options["value"] * 2**32), np.uint32)

guided = Shader("guided", numpy=shown, options={"strength": 0.5})
fixed = Sampler("fixed", numpy=draws, options={"value": 0.25}, smooth=True)

def made(strength=0.5, depth=3):
    return Shader("made", numpy=shown, options={"strength": strength})

class Fog:
    """Its options are the class's own."""

    name, options, lights, jitted = "fog", {"density": 0.5}, "one", None

    numpy = staticmethod(lambda context, origins, *_: np.full(origins.shape, context.options["density"]))

text = Shader("text", jitted=shown, options={"mode": "fast"})

class Grid:
    name = "grid"

    def __init__(self, cells):
        self.options = {"cells": cells}

class Engine:
    """Grey of as many as its accelerator has cells."""

    name, version = "counting", "1"

    def why_not(self, scene, settings):
        return None

    def prepare(self, scene, settings):
        cells = choices.resolve("accelerator", settings.accelerator, {"auto": {}}).options["cells"]
        return Renderer(Film(*settings.size(scene)), cells)

    def accelerators(self):
        return {"auto": {}}

class Renderer:
    def __init__(self, film, cells):
        self.film, self.cells = film, cells

    def warm_up(self): ...
    def stop(self): ...
    def counters(self):
        return {}

    def render(self, spp, on_pass=None):
        for _ in range(spp):
            self.film.add(np.full(self.film.sums.shape, float(self.cells)))
        return self.film
'''
SCENE = "raybench_scene: 1\ncamera: {type: perspective, eye: [0, 0, 5], target: [0, 0, 0], resolution: [4, 3]}\nlights: []\n"
CONFIG = """
raybench_experiment: 1
name: mine
scene: empty.yaml
resolution: [4, 3]
matrix: {{{matrix}}}
{more}
budget: {{max_time: 1s, max_spp: 2, timeout: 60s}}
checkpoints: {{ratio: 2}}
repeats: 1
aa_twin: false
remeasure: 0
reference: {{engine: numpy, sampler: random, spp: 4, certify: null}}
quality: {{targets: [1.0e-1]}}
"""


@pytest.fixture
def folder(tmp_path, request, monkeypatch):
    """A folder with code under a name of its own, as modules live as long as the process; it is not the working directory."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    name = f"mine_{abs(hash(request.node.name))}"
    place = tmp_path / "beside"
    place.mkdir()
    (place / f"{name}.py").write_text(CODE)
    (place / "empty.yaml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    return place, name


def planned(folder, matrix, more=""):
    place, name = folder
    (place / "mine.yaml").write_text(CONFIG.format(matrix=matrix, more=more).replace("mine:", f"{name}:"))
    return planner.make(config.load(place / "mine.yaml"), allow_imports=True)


def test_options_of_plugins_in_a_config_are_part_of_a_cells_identity_and_name(folder):
    values = [f'{{name: "mine:guided", strength: {value}}}' for value in (0.2, 0.5)]
    plan = planned(folder, f'shader: ["mine:guided", {", ".join(values)}]', "engine: numpy")
    named = {str(cell.settings.shader).partition("(")[2] for cell in plan.cells}
    assert named == {"strength=0.5)", "strength=0.2)"}
    assert len({cell.cell_id for cell in plan.cells}) == 2, "a default that is written is the default"
    assert not any(cell.skip for cell in plan.cells)


def test_a_run_gives_options_to_workers_that_find_the_code_beside_the_config(folder, tmp_path):
    plan = planned(
        folder,
        'sampler: ["mine:fixed", {name: "mine:fixed", value: 0.75}]',
        'engine: numpy\nshader: {name: "mine:made", strength: 2}',
    )
    outcome, _ = sweeping.run_plan(plan, tmp_path / "out")
    assert outcome.states == {"done": 2}, outcome.failures
    events = [event for event in store.read_events(tmp_path / "out") if getattr(event, "state", None) == "done"]
    assert {event.sampler.options["value"] for event in events} == {0.25, 0.75}
    assert all(event.shader == Choice(f"{folder[1]}:made", {"strength": 2, "depth": 3}) for event in events)


@pytest.mark.parametrize(("value", "grey"), [(0.25, 0.5), (0.75, 1.5)])
def test_options_reach_shader_and_sampler(folder, value, grey):
    place, name = folder
    sys.path.insert(0, str(place))
    plain = {
        "shader": Choice(f"{name}:made", {"strength": 2}),
        "sampler": Choice(f"{name}:fixed", {"value": value}),
        "accelerator": Choice("auto"),
        "precision": None,
        "threads": 1,
        "width": None,
        "height": None,
    }
    scene = engines.load_scene(place / "empty.yaml")
    film = engines.engine("numpy").prepare(scene, engine_settings(CellSettings(**plain), 1, True)).render(1)
    assert np.allclose(film.mean(), grey)


def test_options_of_a_class_without_arguments_are_its_own(folder):
    place, name = folder
    sys.path.insert(0, str(place))
    assert completed("shader", Choice(f"{name}:Fog"), True).options == {"density": 0.5}
    settings = engines.Settings(shader=plugin_or_choice("shader", Choice(f"{name}:Fog", {"density": 3.0}), True))
    scene = engines.load_scene(place / "empty.yaml")
    assert np.allclose(engines.engine("numpy").prepare(scene, settings).render(1).mean(), 3.0)


def test_options_that_are_no_numbers_are_refused_by_jitted_engines(folder):
    place, name = folder
    scene = engines.load_scene(place / "empty.yaml")
    settings = engines.Settings(shader=imported(f"{name}:text", place))
    with pytest.raises(ConfigError, match=r"shader text.mode = 'fast': a number is expected"):
        engines.engine("numba").why_not(scene, settings)


def test_an_option_that_a_plugin_lacks_is_refused_with_the_experiments_file(folder):
    with pytest.raises(ConfigError, match=r"mine.yaml: unknown option of shader 'guided' 'strenth': did you mean 'strength'"):
        planned(folder, 'shader: [{name: "mine:guided", strenth: 1}]', "engine: numpy")


def test_options_reach_an_accelerator(folder):
    place, name = folder
    sys.path.insert(0, str(place))
    given = Choice(f"{name}:Grid", {"cells": 7})
    settings = engines.Settings(accelerator=plugin_or_choice("accelerator", given, True))
    scene = engines.load_scene(place / "empty.yaml")
    assert engines.engine(f"{name}:Engine").prepare(scene, settings).render(1).mean().max() == 7


def test_in_python_a_plugin_is_the_name_of_a_mapping(folder):
    place, name = folder
    guided = imported(f"{name}:guided", place)
    scene = engines.load_scene(place / "empty.yaml")
    constant = {"name": "constant", "value": 0.5}
    settings = engines.Settings(shader={"name": guided, "strength": 4.0}, sampler=constant)
    assert np.allclose(engines.engine("numpy").prepare(scene, settings).render(1).mean(), 2.0)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"name": "mine:guided", "strenth": 1}, UnknownName, "option of shader 'guided' 'strenth': did you mean 'strength'?"),
        ({"name": "mine:guided", "strength": "big"}, ConfigError, "shader guided.strength = 'big': must be a finite number"),
        ({"name": "mine:made", "strenth": 1}, UnknownName, "did you mean 'strength'? known: depth, strength"),
        ({"name": "mine:Grid"}, ConfigError, "mine:Grid': the option 'cells' is missing"),
        ({"name": "mine:Renderer", "film": 1, "cells": 2, "more": 3}, UnknownName, "'more': known: cells, film"),
        ({"name": "mine:shown", "context": 1}, ConfigError, "the option 'origins' is missing"),
        ({"name": "mine:Fog", "densty": 1}, UnknownName, "option of shader 'fog' 'densty': did you mean 'density'?"),
        ({"name": "mine:CODE"}, ConfigError, "mine:CODE: is of type str: an object with a `name` is expected"),
    ],
)
def test_options_that_a_plugin_lacks_are_refused_with_those_that_it_has(folder, given, error, message):
    place, name = folder
    sys.path.insert(0, str(place))
    given = {**given, "name": given["name"].replace("mine", name)}
    with pytest.raises(error) as refused:
        plugin_or_choice("shader", Choice.of(given), True)
    assert message in str(refused.value).replace(name, "mine")


def test_code_is_not_imported_without_leave(folder):
    with pytest.raises(ConfigError, match="run with --allow-imports if you trust it"):
        completed("shader", Choice(f"{folder[1]}:guided", {"strength": 1}), False)


def test_render_takes_options_of_a_plugin_of_the_working_directory(folder, monkeypatch):
    from typer.testing import CliRunner

    from harness.cli.commands import app

    place, name = folder
    monkeypatch.chdir(place)
    arguments = ["render", "empty.yaml", "--engine", "numpy", "--spp", "1", "--allow-imports", "-o", "x.exr"]
    arguments += ["--shader", f"{{name: '{name}:guided', strength: 3}}", "--sampler", f"{{name: '{name}:fixed', value: 0.5}}"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    from engines.image import read_image, read_provenance

    assert np.allclose(read_image("x.exr"), 1.5)
    assert read_provenance("x.exr")["settings"]["shader"] == {"name": f"{name}:guided", "strength": 3}


CAMERA = """
from engines.plugin import Camera

def rays(x, y, width, height, options):
    raise AssertionError

camera = Camera("{word}", numpy=rays)
"""


def scene_in(folder: Path, module: str) -> Path:
    (folder / f"{module}.py").write_text(CAMERA.replace("{word}", folder.name))
    (folder / "scene.yaml").write_text(f"raybench_scene: 1\ncamera: {{type: '{module}:camera'}}\nlights: []\n")
    return folder / "scene.yaml"


def test_a_scenes_plugin_is_found_beside_it_before_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    place = tmp_path / "near"
    place.mkdir()
    scene = scene_in(place, "camera_near")
    scene_in(tmp_path, "camera_near")
    assert engines.load_scene(scene, allow_imports=True).camera.plugin.name == "near"
    assert sys.path[-1] == str(place), "what it imports later lies there, behind all else"


def test_two_modules_of_one_name_are_refused_not_mistaken(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    scenes = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        scenes.append(scene_in(tmp_path / name, "camera_twice"))
    engines.load_scene(scenes[0], allow_imports=True)
    with pytest.raises(RaybenchError, match=r"two/camera_twice.py has the name of a module that is in use, .*one/camera"):
        engines.load_scene(scenes[1], allow_imports=True)
