"""A camera, shape, light, BSDF, wrapper or texture of a type that nobody knows: every engine, exporter and writer refuses it in
one sentence that says which type it is and where it stands."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import engines
from engines.errors import ConfigError, RaybenchError, Unsupported
from engines.kernels.resolve import known
from engines.kernels.stages.camera import RAYS
from engines.peers.export import export
from engines.peers.external.scenes import FORMATS
from engines.scene import Camera, CustomCamera, Diffuse, Mask, Material, Sides, save_scene
from engines.scene.bsdf_tree import is_opaque
from tests.plain_scene import plain_scene

ENGINES = ("numpy", "numba", "embree", "embreex_batch", "mitsuba", "mitsuba_scalar", "luxcore", "cycles")


@dataclass(frozen=True, slots=True)
class Kaleidoscope:
    """A camera."""

    resolution: tuple[int, int] = (4, 3)
    eye: tuple[float, float, float] = (0.0, 0.0, 5.0)


@dataclass(frozen=True, slots=True)
class Torus:
    """A shape."""

    material: int = 0

    def bounds(self) -> None:
        return None


@dataclass(frozen=True, slots=True)
class Laser:
    """A light."""

    power: float = 1.0


@dataclass(frozen=True, slots=True)
class Velvet:
    """A BSDF."""

    sheen: float = 1.0


@dataclass(frozen=True, slots=True)
class Varnish:
    """A wrapper."""

    of: Any


@dataclass(frozen=True, slots=True)
class Noise:
    """A texture."""

    scale: float = 1.0


PLAIN = plain_scene()


def of(bsdf: Any) -> engines.Scene:
    return replace(PLAIN, materials=(Material("cloth", bsdf=bsdf),))


SCENES = {
    "camera Kaleidoscope": replace(PLAIN, camera=Kaleidoscope()),
    "shapes[1]: shape Torus": replace(PLAIN, shapes=(*PLAIN.shapes, Torus())),
    "lights[1]: light Laser": replace(PLAIN, lights=(*PLAIN.lights, Laser())),
    "material 'cloth': BSDF Velvet": of(Velvet()),
    "material 'cloth': BSDF Varnish": of(Varnish(Diffuse())),
    "material 'cloth': texture Noise": of(Diffuse(Noise())),
}
INSIDE = of(Sides(Diffuse(), Mask(0.5, Velvet())))


def check(name: str, sentence: str | None) -> None:
    where, _, what = name.rpartition(": ")
    assert sentence is not None and sentence.endswith(f"does not support the {what}") and sentence.startswith(where)
    assert "\n" not in sentence and sentence.count("does not support") == 1


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_refuses_what_it_does_not_know(engine, name):
    settings = engines.Settings(8, 6, sampler="sobol" if engine == "cycles" else "random")
    made = engines.engine(engine)
    made = getattr(made, "local", made)  # and not its process
    check(name, made.why_not(SCENES[name], settings))
    with pytest.raises(Unsupported) as refused:
        made.prepare(SCENES[name], settings)
    check(name, str(refused.value))


@pytest.mark.parametrize("engine", ["numpy", "numba", "mitsuba"])
def test_an_engine_looks_inside_of_wrappers(engine):
    check("material 'cloth': BSDF Velvet", engines.engine(engine).why_not(INSIDE, engines.Settings(sampler="random")))


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@pytest.mark.parametrize("name", [name for name in SCENES if "camera" in name or "shape" in name])
def test_an_update_with_something_unknown_is_refused_and_changes_nothing(engine, name):
    renderer = engines.engine(engine).prepare(PLAIN, engines.Settings(4, 3, shader="depth_map"))
    camera = SCENES[name].camera if "camera" in name else None
    with pytest.raises(Unsupported) as refused:
        renderer.update(camera=camera, shapes=None if camera else SCENES[name].shapes)
    check(name, str(refused.value))
    fresh = engines.engine(engine).prepare(PLAIN, engines.Settings(4, 3, shader="depth_map"))
    assert np.array_equal(renderer.render(1).sums, fresh.render(1).sums)


def test_an_engine_of_rays_alone_looks_at_shapes_alone():
    open3d, settings = engines.engine("open3d"), engines.Settings()
    check("shapes[1]: shape Torus", open3d.why_not_tracer(replace(PLAIN, shapes=(*mesh().shapes, Torus())), settings))
    assert "does not support" not in str(open3d.why_not_tracer(replace(mesh(), lights=(Laser(),)), settings))


def mesh() -> engines.Scene:
    triangle = {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}}
    camera = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]}
    keys = {"materials": {"it": {"kd": 0.5}}, "shapes": [{**triangle, "material": "it"}]}
    return engines.scene_from({"raybench_scene": 1, "camera": camera, **keys})


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("form", ["mitsuba", "pbrt"])
def test_an_exporter_refuses_what_it_does_not_know_and_leaves_no_file(form, name, tmp_path):
    with pytest.raises(Unsupported) as refused:
        export(SCENES[name], form, tmp_path)
    check(name, str(refused.value))
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.parametrize("name", SCENES)
def test_the_writer_of_scenes_refuses_what_it_does_not_know_and_leaves_no_file(name, tmp_path):
    with pytest.raises(ConfigError) as refused:
        save_scene(SCENES[name], tmp_path / "out")
    check(name, str(refused.value))
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.parametrize("name", SCENES)
def test_a_program_is_not_given_the_file_of_a_scene_that_has_changed(name, tmp_path):
    scene = replace(SCENES[name], source=str(tmp_path / "scene.yaml"))
    with pytest.raises(Unsupported) as refused:
        FORMATS["raybench"](scene, engines.Settings(), tmp_path)
    check(name, str(refused.value))


@pytest.mark.parametrize("name", SCENES)
def test_the_command_line_says_it_in_a_line_and_ends_with_2(name, tmp_path, monkeypatch, capsys):
    from harness.cli import main

    monkeypatch.setattr("harness.cli.render.load_scene", lambda *_, **__: SCENES[name])
    monkeypatch.setattr(sys, "argv", ["raybench", "render", "cornell_box", "--engine", "numba", "-o", str(tmp_path / "x.png")])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err.strip()
    assert ended.value.code == 2 and said.count("\n") == 0
    check(name, said.removeprefix("raybench: "))


def test_of_an_unknown_type_nothing_is_claimed():
    assert not is_opaque(Velvet()) and not is_opaque(Varnish(Diffuse())) and not is_opaque(Sides(Diffuse(), Velvet()))
    assert is_opaque(Diffuse()) and is_opaque(Sides(Diffuse(), None)) and not is_opaque(Mask(0.5, Diffuse()))


def test_a_plugin_is_called_by_its_name():
    with pytest.raises(RaybenchError, match=r"^pbrt does not support the camera plugin 'fisheye'$"):
        export(replace(PLAIN, camera=CustomCamera(type("Fisheye", (), {"name": "fisheye"})(), {}, (4, 3))), "pbrt", Path("."))


def test_the_jitted_engines_have_a_function_for_each_camera_that_they_say_they_know():
    assert {each for each in known() if each in get_args(Camera)} == {*RAYS, CustomCamera}
