"""Every type that a scene may hold is known to both implementations of light transport, and how NumPy finds its own."""

import sys
from typing import get_args

import pytest

from engines.kernels.flatten import lights as lights_of_kernels
from engines.kernels.flatten.materials import KINDS
from engines.kernels.flatten.programs import WRAPPERS
from engines.kernels.flatten.shapes import ANALYTIC
from engines.numpy_reference.bsdf import BSDFS
from engines.numpy_reference.lights import LIGHTS
from engines.numpy_reference.registry import collect
from engines.numpy_reference.shapes import SHAPES
from engines.scene import Bsdf, Instance, Light, Mesh, Plane, Shape, Single, Sphere, SphereSet, Triangle, Wrapper


def test_both_implementations_have_every_light():
    assert set(LIGHTS) == set(lights_of_kernels.ROWS) == set(get_args(Light))


def test_both_implementations_have_every_bsdf():
    leaves = set(get_args(Bsdf)) - set(get_args(Wrapper))
    assert set(BSDFS) == set(KINDS) == leaves
    assert set(WRAPPERS) == set(get_args(Wrapper))


def test_both_implementations_have_every_shape_but_instances():
    with_lists_of_their_own = {Plane, Sphere, SphereSet, Triangle, Mesh}
    assert set(SHAPES) == with_lists_of_their_own | set(ANALYTIC) == set(get_args(Single))
    assert set(get_args(Shape)) == {*get_args(Single), Instance}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A function that writes modules of a package, and returns the package's name and folders."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(name, **modules):
        (tmp_path / name).mkdir()
        for module, text in {"__init__": "", **modules}.items():
            (tmp_path / name / f"{module}.py").write_text(text)
        return name, [str(tmp_path / name)]

    yield write
    for module in [name for name in sys.modules if name.startswith("collected_")]:
        del sys.modules[module]


def test_tables_of_the_modules_are_joined(package):
    made = package("collected_tables", b="T = {int: str}", a="T = {float: bytes, bool: list}", c="")
    assert list(collect("T", *made).items()) == [(float, bytes), (bool, list), (int, str)]


def test_a_type_in_two_tables_is_refused(package):
    made = package("collected_twice", copied="T = {int: str}", original="T = {int: bytes}")
    with pytest.raises(ValueError, match=r"collected_twice\.original\.T: int has a model already, str"):
        collect("T", *made)
