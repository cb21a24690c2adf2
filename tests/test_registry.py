"""Engines by name, by entry point, by `module:attribute`, and what is said when one is broken."""

import sys
import types
from importlib.metadata import EntryPoint

import pytest

from engines import registry
from engines.errors import ConfigError, UnknownName
from engines.registry import BUILT_IN, GROUP, engine, engine_names, load_attribute


class Plain:
    """As little as an engine can be."""

    name, version = "plain", "1"

    def why_not(self, scene, settings):
        return "it renders nothing"

    def prepare(self, scene, settings):
        raise NotImplementedError

    def accelerators(self):
        return {}


class Exploding(Plain):
    def __init__(self):
        raise OSError("no such device")


@pytest.fixture
def plugins(monkeypatch):
    """Installs entry points for the length of a test, in a module called `outside`."""
    outside = types.ModuleType("outside")
    outside.Plain, outside.Exploding, outside.made, outside.seven = Plain, Exploding, Plain(), 7  # pyright: ignore
    monkeypatch.setitem(sys.modules, "outside", outside)

    def install(**values):
        points = [EntryPoint(name, value, GROUP) for name, value in values.items()]
        monkeypatch.setattr(registry, "entry_points", lambda group: points if group == GROUP else [])

    install()
    return install


def test_ours_come_first_and_plugins_after_in_order(plugins):
    plugins(zebra="outside:Plain", ant="outside:Plain")
    assert engine_names() == [*BUILT_IN, "ant", "zebra"]


def test_names_are_listed_without_importing_a_plugin(plugins):
    plugins(broken="nowhere_at_all:Engine", shattered="outside:missing", raw="not even a path")
    assert engine_names() == [*BUILT_IN, "broken", "raw", "shattered"]


def test_an_entry_point_may_be_a_class_or_an_object(plugins):
    plugins(a="outside:Plain", b="outside:made")
    assert engine("a").name == "plain"
    assert engine("b") is sys.modules["outside"].made


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("nowhere_at_all:Engine", "nowhere_at_all"),
        ("outside:missing", "missing"),
        ("outside:Exploding", "no such device"),
        ("outside:seven", "no engine: it lacks name, version, why_not, prepare, accelerators"),
    ],
)
def test_a_broken_plugin_is_an_error_that_names_it(plugins, value, said):
    plugins(broken=value, whole="outside:Plain")
    with pytest.raises(ConfigError, match=f"'broken'.*{said}"):
        engine("broken")
    assert engine("whole").name == "plain"


def test_a_plugin_cannot_take_the_name_of_one_of_ours(plugins):
    plugins(numba="outside:Plain")
    with pytest.warns(UserWarning, match="'numba' is registered twice: engines.numba_cpu:Engine is used"):
        assert engine_names() == list(BUILT_IN)


def test_the_first_of_two_plugins_of_one_name_is_used(plugins, monkeypatch):
    points = [EntryPoint("twin", "outside:made", GROUP), EntryPoint("twin", "outside:Exploding", GROUP)]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    with pytest.warns(UserWarning, match="'twin' is registered twice: outside:made is used"):
        assert engine("twin").name == "plain"


def test_our_own_entry_points_are_not_listed_twice(plugins):
    plugins(**BUILT_IN)
    assert engine_names() == list(BUILT_IN)


def test_a_module_and_attribute_need_no_registration(plugins):
    assert engine("outside:Plain").name == "plain"
    assert engine("outside:made") is sys.modules["outside"].made


@pytest.mark.parametrize("path", ["nowhere_at_all:Engine", "outside:missing", "outside", "outside:", ":Plain"])
def test_a_path_that_leads_nowhere_is_an_error_that_names_it(plugins, path):
    with pytest.raises(ConfigError, match=path):
        load_attribute(path)


def test_an_attribute_of_an_attribute_is_found(plugins):
    assert load_attribute("outside:Plain.name") == "plain"


def test_an_engine_object_is_returned_as_it_is():
    made = Plain()
    assert engine(made) is made
    assert isinstance(engine(Plain), Plain)


def test_what_is_no_engine_is_refused():
    with pytest.raises(ConfigError, match="is no engine: it lacks"):
        engine(7)


def test_an_unknown_engine_names_the_nearest_and_the_plugins(plugins):
    plugins(optix="outside:Plain")
    with pytest.raises(UnknownName, match=r"did you mean 'embree'.*optix"):
        engine("embre")


@pytest.mark.parametrize("name", [None, 3, "", " ", "two\nlines", b"bytes"])
def test_an_engine_without_a_name_that_tables_can_hold_is_refused(name):
    unnamed = Plain()
    unnamed.name = name
    with pytest.raises(ConfigError, match=r"its name is .*: a line of text is expected"):
        engine(unnamed)


def test_an_engine_that_exits_when_it_is_made_is_an_error_and_no_exit(plugins, monkeypatch):
    monkeypatch.setattr(Plain, "__init__", lambda self: sys.exit("the licence has expired"), raising=False)
    plugins(a="outside:Plain")
    with pytest.raises(ConfigError, match="cannot be created: the licence has expired"):
        engine("a")
