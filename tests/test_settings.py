"""Settings refuse what no engine could use."""

import numpy as np
import pytest

from engines.errors import ConfigError, UnknownName
from engines.interface import Settings
from engines.scene import Perspective, Scene

CAMERA = Perspective((0, 0, 5), (0, 0, 0), (0, 1, 0), 40.0, "y", (320, 200))
SCENE = Scene("empty", CAMERA, (), (), (), "0")


def test_the_size_defaults_to_the_scene_and_each_side_can_be_set():
    assert Settings().size(SCENE) == (320, 200)
    assert Settings(width=16).size(SCENE) == (16, 200)
    assert Settings(width=16, height=8).size(SCENE) == (16, 8)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[(key, value) for key in ("width", "height", "threads") for value in (0, -1, 2.0, True, "2", float("nan"))],
        *[("threads", None), ("threads", 1025), ("width", 65_537)],
        *[("seed", value) for value in (-1, 2**64, 1.0, None, False)],
        *[("precision", value) for value in ("float16", 64, "")],
    ],
)
def test_a_value_out_of_range_is_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=f"settings.{key} = "):
        Settings(**{key: value})


def test_integers_of_numpy_become_plain():
    settings = Settings(width=np.int64(8), seed=np.uint64(2**64 - 1))
    assert type(settings.width) is int
    assert settings.seed == 2**64 - 1


def test_resolved_settings_have_every_choice_and_a_precision():
    found = Settings(width=8, shader={"name": "path_tracer", "max_depth": 3}).resolved({"auto": {}}, "float32")
    assert (found.shader.name, found.shader.options["max_depth"]) == ("path_tracer", 3)
    assert (found.sampler.name, found.accelerator.name, found.precision, found.width) == ("sobol", "auto", "float32", 8)
    assert Settings(precision="float64").resolved({"auto": {}}, "float32").precision == "float64"
    assert found.resolved({"auto": {}}, "float64") == found


@pytest.mark.parametrize("key", ["shader", "sampler", "accelerator"])
def test_a_name_that_is_in_no_table_is_refused(key):
    tables = {"accelerators": {"auto": {}}, "precision": "float32", "samplers": {"sobol": {}}}
    with pytest.raises(UnknownName, match=key):
        Settings(**{key: "halton"}).resolved(**tables)
    assert Settings(shader="own").resolved(**tables, shaders={"own": {}}).shader.name == "own"
