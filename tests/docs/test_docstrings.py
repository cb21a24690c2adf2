"""No public name without a docstring: every module, class, function, method and property that the reference shows."""

import importlib
import inspect
import re
from dataclasses import is_dataclass

import pytest

import engines
from docs._ext.library import API, public
from tests.test_layout import PUBLIC

SHOWN = sorted({name for page in API.glob("*.md") for name in re.findall(r"automodule:: ([\w.]+)", page.read_text())})


def without_words(name, found):
    """Names below `name`, itself included, that have no docstring of their own."""
    doc = found.__doc__ or ""
    if not doc.strip() or (is_dataclass(found) and doc.startswith(f"{found.__name__}(")):
        yield name
    if not inspect.isclass(found):
        return
    for key, member in vars(found).items():
        shown = inspect.isfunction(member) or isinstance(member, (classmethod, staticmethod, property))
        if shown and not key.startswith("_") and not inspect.getdoc(getattr(found, key)):
            yield f"{name}.{key}"


@pytest.mark.parametrize("module", sorted({*PUBLIC, *SHOWN, "engines.plugin"}))
def test_every_public_name_has_a_docstring(module):
    found = importlib.import_module(module)
    assert found.__doc__, module
    assert [lack for name, each in public(found) for lack in without_words(f"{module}.{name}", each)] == []


def test_the_reference_shows_every_name_of_the_library():
    shown = {name for module in SHOWN for name, _ in public(importlib.import_module(module))}
    assert set(engines.__all__) - {"register_tone_mapper"} <= shown


def test_a_missing_docstring_is_seen():
    class Silent:
        """Words."""

        def speak(self):
            pass

    assert list(without_words("Silent", Silent)) == ["Silent.speak"]
