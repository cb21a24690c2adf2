"""Renderers of others can be imported from where they were, with a warning that says where they are."""

import importlib
import sys

import pytest

import engines
from tests.test_layout import MOVED


@pytest.mark.parametrize("name", MOVED)
def test_a_former_place_warns_and_has_the_same_names(name):
    sys.modules.pop(f"engines.{name}", None)
    with pytest.warns(DeprecationWarning, match=f"import engines.peers.{name}$"):
        former = importlib.import_module(f"engines.{name}")
    now = importlib.import_module(f"engines.peers.{name}")
    assert all(getattr(former, each) is getattr(now, each) for each in now.__all__)


def test_an_engine_is_made_of_its_former_place():
    with pytest.warns(DeprecationWarning):
        sys.modules.pop("engines.open3d", None)
        assert type(engines.engine("engines.open3d:Engine")) is type(engines.engine("engines.peers.open3d:Engine"))
