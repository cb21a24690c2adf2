"""Names and options of shaders, samplers and accelerators."""

from types import SimpleNamespace

import numpy as np
import pytest

from engines.choices import SAMPLERS, SHADERS, Choice, Option, resolve
from engines.errors import ConfigError, UnknownName

TABLES = {"shader": SHADERS, "sampler": SAMPLERS}
EVERY = [(kind, name) for kind, table in TABLES.items() for name in table]


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_name_brings_every_option_at_its_default(kind, name):
    known = TABLES[kind][name]
    choice = resolve(kind, name, TABLES[kind])
    assert choice == Choice(name, {key: option.default for key, option in known.items()})


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_every_default_passes_its_own_check_and_is_explained(kind, name):
    for option in TABLES[kind][name].values():
        assert option.check(option.default) is None
        assert option.meaning


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_described_choice_resolves_to_itself(kind, name):
    choice = resolve(kind, name, TABLES[kind])
    assert resolve(kind, choice.describe(), TABLES[kind]) == choice
    assert resolve(kind, choice, TABLES[kind]) == choice


def test_a_mapping_changes_the_options_it_names():
    choice = resolve("shader", {"name": "path_tracer", "max_depth": 3}, SHADERS)
    assert choice.options == {
        "max_depth": 3,
        "rr_depth": 5,
        "direct": "mis",
        "light_sampler": "uniform",
        "light_candidates": 1,
        "transparent_shadows": False,
        "hide_emitters": False,
        "guiding": "none",
        "bsdf_fraction": 0.5,
        "spatial_threshold": 4000,
        "flux_threshold": 0.01,
    }


def test_numbers_of_numpy_become_plain():
    choice = resolve("shader", {"name": "path_tracer", "max_depth": np.int32(3)}, SHADERS)
    assert type(choice.options["max_depth"]) is int


def test_what_the_user_wrote_is_left_alone():
    written = {"name": "path_tracer", "max_depth": 3}
    resolve("shader", written, SHADERS)
    assert written == {"name": "path_tracer", "max_depth": 3}


def test_a_plugin_is_taken_as_it_is():
    plugin = SimpleNamespace(name="mine", options={"gain": 2.0})
    choice = resolve("shader", plugin, SHADERS)
    assert choice == Choice("mine", {"gain": 2.0}, plugin)
    assert resolve("shader", choice, SHADERS) is choice
    assert resolve("shader", SimpleNamespace(name="bare"), SHADERS).options == {}


def test_an_unknown_name_names_the_nearest_and_all():
    with pytest.raises(UnknownName, match=r"unknown shader 'path_tracr': did you mean 'path_tracer'.*albedo.*whitted"):
        resolve("shader", "path_tracr", SHADERS)


def test_an_unknown_option_names_the_nearest():
    with pytest.raises(UnknownName, match="option of shader 'whitted' 'maxdepth': did you mean 'max_depth'"):
        resolve("shader", {"name": "whitted", "maxdepth": 3}, SHADERS)


@pytest.mark.parametrize(
    ("kind", "written", "message"),
    [
        ("shader", {"name": "whitted", "max_depth": 0}, r"whitted.max_depth = 0: must be an integer in \[1, 32\]"),
        ("shader", {"name": "whitted", "max_depth": True}, "an integer"),
        ("shader", {"name": "whitted", "max_depth": 2.0}, "an integer"),
        ("shader", {"name": "whitted", "max_depth": "2"}, "an integer"),
        ("shader", {"name": "whitted", "ambient": float("nan")}, "a number"),
        ("shader", {"name": "whitted", "ambient": float("inf")}, "a number"),
        ("shader", {"name": "whitted", "ambient": -1e-9}, "a number"),
        ("shader", {"name": "path_tracer", "direct": "all"}, "one of light, bsdf, mis"),
        ("shader", {"name": "depth_map", "max_point": [1, 2]}, "three numbers"),
        ("shader", {"name": "depth_map", "max_point": [1, 2, None]}, "three numbers"),
        ("sampler", {"name": "stratified", "strata": 32}, "one of 4, 16"),
        ("sampler", {"name": "stratified", "strata": 64.0}, "one of 4, 16"),
        ("sampler", {"name": "constant", "value": 1.0}, "a number in"),
    ],
)
def test_a_value_out_of_range_is_refused_with_the_range(kind, written, message):
    with pytest.raises(ConfigError, match=message):
        resolve(kind, written, TABLES[kind])


@pytest.mark.parametrize("written", [None, 3, ["whitted"], {}, {"max_depth": 3}, {"name": 7}, {"name": None}])
def test_what_names_nothing_is_refused(written):
    with pytest.raises(ConfigError, match=r"shader = .*name"):
        resolve("shader", written, SHADERS)


def test_an_accelerator_table_of_an_engine_works_alike():
    table = {"bvh": {"leaf": Option(4, "primitives a leaf", lambda value: None if value > 0 else "positive")}}
    assert resolve("accelerator", "bvh", table).describe() == {"name": "bvh", "leaf": 4}
    with pytest.raises(UnknownName, match="unknown accelerator"):
        resolve("accelerator", "grid", table)
