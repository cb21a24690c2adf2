"""The inner floors of engines/kernels, read from the sources as in `test_layout`: which room may import from which."""

import sys

import pytest

from tests.test_layout import MODULES, imports, targets

KERNELS = "engines.kernels."
COMPILED = {"compile.dispatch", "compile.jit", "compile.values"}
"""What every room writes compiled code with."""

FLOORS: dict[str, set[str]] = {
    "compile": set(),
    "features": set(),
    "rows": {"compile.records"},
    "layout": {"compile.jit", "compile.masks", "compile.records", "compile.vec3", "integrators", "lane", "rows"},
    "lane": {*COMPILED, "compile.vec3", "features"},
    "integrators": {*COMPILED, "compile.vec3", "lane"},
    "flatten": {*COMPILED, "compile.records", "features", "lane", "layout", "rows"},
    "stages": {
        *(*COMPILED, "compile.masks", "compile.records", "compile.row_loads", "compile.simd"),
        *("features", "flatten", "integrators", "lane", "layout", "rows"),
    },
    "guide_records": COMPILED,
    "driver": {*COMPILED, "compile.masks", "guide_records", "lane", "layout"},
    "queries": {*COMPILED, "compile.vec3", "driver", "layout"},
    "pipeline": {"compile.second_process", "features", "flatten", "stages"},
    "renderer": {
        *("compile.jit", "compile.second_process", "driver", "flatten", "guide_records", "layout", "pipeline", "queries"),
        *("resolve", "stages"),
    },
    "resolve": {"flatten", "layout", "rows"},
}
"""Of each room, the rooms and modules of engines/kernels that it may import. It may also import itself."""

OUTSIDE: dict[str, set[str]] = {
    "compile": {"engines.errors", "engines.packages", "llvmlite", "numba", "numpy"},
    "features": set(),
    "rows": {"numpy"},
    "layout": {"numpy"},
    "lane": {"numpy"},
    "integrators": {"numpy"},
    "flatten": {
        *("engines.scene", "engines.scene.bsdf_tree", "engines.scene.light_bounds", "engines.light_cells"),
        *("engines.scene.light_hierarchy", "engines.scene.support", "engines.sd_tree", "numpy"),
    },
    "guide_records": {"engines.sd_tree", "numpy"},
    "stages": {
        *("engines.choices", "engines.scene", "engines.scene.support", "engines.sd_tree", "engines.sobol_numbers", "numpy")
    },
    "driver": {"numpy"},
    "queries": {"numpy"},
}
"""What a room may import from elsewhere, the standard library apart. Other rooms follow `test_layout` alone."""

ROOMS = {name: path for name, path in MODULES.items() if name.startswith(KERNELS)}


def room_of(module: str) -> str:
    return module.removeprefix(KERNELS).partition(".")[0]


def forbidden_imports(name: str, source: str, is_package: bool = False) -> list[str]:
    """One line for every import of `source`, as module `name` of engines/kernels, that FLOORS and OUTSIDE forbid."""
    room, found = room_of(name), []
    for line, module, names in imports(name, source, is_package):
        for target in sorted(targets(module, names)):
            if target.startswith(KERNELS):
                inner = target.removeprefix(KERNELS)
                allowed = {room_of(target), ".".join(inner.split(".")[:2])} & {room, *FLOORS[room]}
            else:
                allowed = {target, target.partition(".")[0]} & {*OUTSIDE.get(room, {target}), *sys.stdlib_module_names}
            if not allowed:
                found.append(f"{name}:{line} imports {target}: {room} may import {sorted(FLOORS[room])}")
    return found


def test_rooms_import_from_the_floors_below():
    found = [forbidden_imports(name, path.read_text(), path.name == "__init__.py") for name, path in ROOMS.items()]
    assert [line for lines in found for line in lines] == []
    assert {room_of(name) for name in ROOMS} == set(FLOORS)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("engines.kernels.lane.sphere", "from engines.kernels.layout import ray_batch"),
        ("engines.kernels.lane.sphere", "from engines.kernels.compile.memory import load"),
        ("engines.kernels.lane.sphere", "from engines.kernels.compile import records"),
        ("engines.kernels.lane.sphere", "from engines.scene import Sphere"),
        ("engines.kernels.lane.bsdf.plastic", "def f():\n    from engines.kernels.stages import surface"),
        ("engines.kernels.lane.bsdf.plastic", "import numba"),
        ("engines.kernels.integrators.volumes", "from engines.kernels.flatten.lights import MODELS"),
        ("engines.kernels.integrators.volumes", "from engines.kernels.layout import LANES"),
        ("engines.kernels.flatten.textures", "from engines.kernels.stages import surface"),
        ("engines.kernels.stages.light", "from engines.kernels import driver"),
        ("engines.kernels.stages.light", "from engines.kernels.compile.simd_types import Simd"),
        ("engines.kernels.stages.light", "from engines.interface import Settings"),
        ("engines.kernels.compile.jit", "from engines.kernels.layout import LANES"),
        ("engines.kernels.compile.jit", "from engines.kernels import features"),
        ("engines.kernels.driver", "from engines.kernels.stages import shade"),
    ],
)
def test_an_import_from_a_floor_above_is_seen(name, line):
    assert forbidden_imports(name, line) != []
