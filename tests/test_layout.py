"""The packages and their import rules, read from the sources with ast: nothing is imported here.

`ALLOWED` says which first-party modules each part may import (`test_layout_kernels` and `test_layout_harness` have the
floors within two of them), `ONLY_IN` where a third-party package may appear, and `PUBLIC` what of `engines` the harness, or
any other program, may rely on. Plugins for the jitted engines have `engines.plugin` besides, which only they import: it
brings the compiler along.
"""

import ast
import graphlib
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

TOP_LEVEL = {
    *("pyproject.toml", "README.md", "LICENSE", "Makefile", ".ci", ".gitignore"),
    *("CITATION.cff", "CHANGELOG.md", "CONTRIBUTING.md", ".github"),  # where their readers look
    *("engines", "harness", "configs", "scenes", "results", "tests", "docs"),
}

PUBLIC = {
    "engines",
    "engines.choices",
    "engines.concurrency",
    "engines.conformance",
    "engines.dahlquist",
    "engines.errors",
    "engines.film",
    "engines.image",
    "engines.imports",
    "engines.input_files",
    "engines.interface",
    "engines.memory",
    "engines.packages",
    "engines.peers.adapters",
    "engines.peers.export",
    "engines.processes",
    "engines.processes.channel",
    "engines.processes.child",
    "engines.processes.pickled",
    "engines.processes.records",
    "engines.registry",
    "engines.scene",
    "engines.schema.keys",
    "engines.schema.kinds",
    "engines.schema.yaml_file",
    "engines.source_files",
    "engines.temporary",
    "engines.tonemap",
}

MOVED = ("adapters", "export", "external", "mitsuba", "open3d")
"""Of `engines.peers`: what can be imported from its former place still."""

_BASE = {
    *("engines.errors", "engines.choices", "engines.concurrency", "engines.packages"),
    *("engines.film", "engines.interface", "engines.scene"),
}
_KERNELS = {"engines.kernels", "engines.kernels.compile"}
_JITTED = {*_BASE, *_KERNELS, "engines.light_cells", "engines.sd_tree", "engines.sobol_numbers"}

ALLOWED: dict[str, set[str]] = {
    "engines.errors": set(),
    "engines.concurrency": set(),
    "engines.input_files": set(),
    "engines.packages": set(),
    "engines.processes": set(),
    "engines.light_cells": {"engines.scene"},
    "engines.sd_tree": set(),
    "engines.sobol_numbers": set(),
    "engines.source_files": set(),
    "engines.temporary": set(),
    "engines.imports": set(),
    "engines.choices": {"engines.errors"},
    "engines.memory": {"engines.errors"},
    "engines.tonemap": {"engines.errors"},
    "engines.film": {"engines.image", "engines.memory", "engines.tonemap"},
    "engines.image": {"engines.errors", "engines.input_files", "engines.memory", "engines.tonemap"},
    "engines.schema": {"engines.errors", "engines.input_files", "engines.memory"},
    "engines.scene": {
        *("engines.errors", "engines.image", "engines.imports", "engines.input_files", "engines.memory"),
        *("engines.packages", "engines.schema", "engines.source_files"),
    },
    "engines.scene.mitsuba_xml.bake_sky": set(),
    "engines.interface": {"engines.errors", "engines.choices", "engines.film", "engines.scene"},
    "engines.registry": {"engines.errors", "engines.imports", "engines.interface"},
    "engines.conformance": _BASE,
    "engines.numpy_reference": {*_BASE, "engines.light_cells", "engines.sd_tree", "engines.sobol_numbers"},
    "engines.kernels": _JITTED,
    "engines.kernels.compile": {"engines.errors", "engines.packages"},
    "engines.plugin": {"engines.errors", *_KERNELS},
    "engines.numba_cpu": _JITTED,
    "engines.embree": _JITTED,
    "engines.dahlquist": {*_BASE, "engines.image", *_KERNELS},
    "engines.embreex_batch": {*_BASE, "engines.numpy_reference"},
    "engines.peers.isolated": {*_BASE, "engines.imports", "engines.processes", "engines.registry"},
    "engines.peers": set(),
    "engines.peers.adapters": _BASE,
    "engines.peers.cycles": {*_BASE, "engines.peers.adapters"},
    "engines.peers.external": {
        *(*_BASE, "engines.image", "engines.schema", "engines.temporary"),
        *("engines.peers.adapters", "engines.peers.export"),
    },
    "engines.peers.export": {*_BASE, "engines.image", "engines.peers.adapters", "engines.peers.mitsuba"},
    "engines.peers.function": {*_BASE, "engines.peers.adapters"},
    "engines.peers.luxcore": {*_BASE, "engines.peers.adapters"},
    "engines.peers.mitsuba": {*_BASE, "engines.imports", "engines.peers.adapters", "engines.source_files", "engines.temporary"},
    "engines.peers.open3d": _BASE,
    **{f"engines.{name}": {f"engines.peers.{name}"} for name in MOVED},
    "engines": {
        *("engines.choices", "engines.errors", "engines.film", "engines.interface"),
        *("engines.registry", "engines.scene", "engines.tonemap"),
    },
    "harness": PUBLIC,
}
"""Each part may also import itself."""

ONLY_IN = {
    "embreex": {"engines.embree", "engines.embreex_batch"},
    "llvmlite": {"engines.kernels.compile"},
    "numba": {"engines.kernels.compile"},
    "mitsuba": {"engines.peers.mitsuba", "engines.scene.mitsuba_xml.bake_sky"},
    "drjit": {"engines.peers.mitsuba"},
    "pyluxcore": {"engines.peers.luxcore"},
    "open3d": {"engines.peers.open3d"},
}

LONG_FILES: dict[str, str] = {}
"""Files above 600 lines, each with the reason why it is one."""


def modules() -> dict[str, Path]:
    """Every first-party module by its dotted name."""
    found = {}
    for path in sorted([*ROOT.glob("engines/**/*.py"), *ROOT.glob("harness/**/*.py")]):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(name: str, source: str, is_package: bool = False) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """Line, imported module and names taken from it, of every import in `source`, lazy and dynamic ones included."""
    package = name if is_package else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name, ()
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            yield node.lineno, ".".join(filter(None, [base, node.module])), tuple(alias.name for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "__import__"):
                yield node.lineno, str(node.args[0].value), ()


def part_of(module: str) -> str:
    """The entry of ALLOWED that `module` belongs to: the longest that is a prefix."""
    found = [part for part in ALLOWED if module == part or module.startswith(part + ".")]
    return max(found, key=len, default="")


def targets(module: str, names: tuple[str, ...]) -> set[str]:
    """What an import statement reaches: submodules where the names are modules, else the module."""
    inner = {f"{module}.{name}" for name in names if f"{module}.{name}" in MODULES}
    return inner | ({module} if len(inner) < len(names) or not names else set())


def broken_rules(name: str, source: str, is_package: bool = False) -> list[str]:
    """One line for every import of `source`, as module `name`, that the rules forbid."""
    part, broken = part_of(name), []
    for line, module, names in imports(name, source, is_package):
        root = module.partition(".")[0]
        if root in ONLY_IN and part not in ONLY_IN[root]:
            broken.append(f"{name}:{line} imports {module}: only {sorted(ONLY_IN[root]) or 'plugins'} may")
        if root not in ("engines", "harness"):
            continue
        for target in targets(module, names):
            reached = target if part == "harness" and root == "engines" else part_of(target)
            if reached != part and reached not in ALLOWED[part]:
                broken.append(f"{name}:{line} imports {target}: {part} may import {sorted(ALLOWED[part])}")
        private = [item for item in names if item.startswith("_") and part_of(module) != part]
        if private:
            broken.append(f"{name}:{line} imports private names of {module}: {private}")
        if part == "harness" and module == "engines":
            hidden = {item for item in names if f"engines.{item}" not in PUBLIC} - exported()
            broken += [f"{name}:{line} imports engines.{item}: not in engines.__all__" for item in sorted(hidden)]
    return broken


def cycles(graph: Mapping[str, set[str]]) -> set[frozenset[str]]:
    """The groups of nodes that reach each other."""
    order = graphlib.TopologicalSorter(graph)
    found: set[frozenset[str]] = set()
    remaining = {node: set(edges) for node, edges in graph.items()}
    while True:
        try:
            order.prepare()
            return found
        except graphlib.CycleError as error:
            group = frozenset(error.args[1])
            found.add(group)
            for node in group:
                remaining[node] -= group
            order = graphlib.TopologicalSorter(remaining)


def import_graph() -> dict[str, set[str]]:
    """What each first-party module imports, lazily or for types alone, too."""
    found = {}
    for name, path in MODULES.items():
        reached = imports(name, path.read_text(), path.name == "__init__.py")
        modules = {target for _, module, names in reached for target in targets(module, names)}
        found[name] = (modules & MODULES.keys()) - {name}
    return found


def exported() -> set[str]:
    """`engines.__all__`."""
    for node in ast.parse((ROOT / "engines/__init__.py").read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return set(ast.literal_eval(node.value))
    raise AssertionError("engines/__init__.py has no __all__")


def test_imports_follow_the_arrows():
    found = [broken_rules(name, path.read_text(), path.name == "__init__.py") for name, path in MODULES.items()]
    assert [line for lines in found for line in lines] == []


def test_no_modules_import_each_other():
    assert cycles(import_graph()) == set()


def test_modules_that_import_each_other_are_found():
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set(), "e": {"f", "a"}, "f": {"e"}}
    assert cycles(graph) == {frozenset("abc"), frozenset("ef")}
    assert cycles({"a": {"b"}, "b": set()}) == set()


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("engines.numpy_reference.sphere", "from engines.kernels.lane.shapes.sphere import sphere_distance"),
        ("engines.numpy_reference.sphere", "import numba"),
        ("engines.numpy_reference.sphere", "from numba.core import types"),
        ("engines.numpy_reference.sphere", "def f():\n    import embreex"),
        ("engines.numpy_reference.sphere", "from ..kernels import lane"),
        ("engines.numpy_reference.sphere", "from .. import kernels"),
        ("engines.numpy_reference.sphere", "importlib.import_module('engines.kernels')"),
        ("engines.kernels.layout", "import embreex.mesh_construction"),
        ("engines.kernels.layout", "from engines.numba_cpu import accel"),
        ("engines.numba_cpu.engine", "from engines.embree import Engine"),
        ("engines.numba_cpu.engine", "import numba"),
        ("engines.scene.load", "from engines import interface"),
        ("engines.scene.load", "from engines.scene_from import x\nfrom engines.registry import load_attribute"),
        ("engines.film", "from engines.scene import Scene"),
        ("engines.errors", "import engines"),
        ("engines.registry", "from engines.numba_cpu import Engine"),
        ("engines.interface", "import harness"),
        ("engines.conformance.hits", "from engines.film import _private"),
        ("harness.measure.worker", "from engines.kernels.compile import jit"),
        ("harness.measure.worker", "import engines.numba_cpu"),
        ("harness.measure.worker", "from engines.plugin import Shader"),
        ("harness.measure.worker", "from engines import kernels"),
        ("harness.measure.worker", "from engines import nothing_exported"),
        ("harness.measure.worker", "from engines.scene.scene import Scene"),
        ("harness.measure.worker", "import numba"),
    ],
)
def test_a_forbidden_import_is_seen(name, line):
    assert broken_rules(name, line) != []


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("engines.numpy_reference.sphere", "from engines.numpy_reference.vectors import _dot"),
        ("engines.numpy_reference.sphere", "from .vectors import dot\nfrom . import vectors"),
        ("engines.embree.device", "import embreex\nfrom engines.kernels import layout"),
        ("harness.measure.worker", "import engines\nfrom engines import Settings, load_scene\nfrom engines.scene import Scene"),
        ("harness.measure.worker", "from engines.schema.yaml_file import read\nfrom harness.measure.clock import _x"),
    ],
)
def test_an_import_along_an_arrow_passes(name, line):
    assert broken_rules(name, line) == []


def test_every_part_of_the_rules_exists():
    there = {part_of(name) for name in MODULES}
    assert there == set(ALLOWED), "a part of ALLOWED is missing in the tree, or the other way round"
    assert set(MODULES) >= PUBLIC


def test_the_public_names_are_there():
    defined = {
        name
        for _, module, names in imports("engines", (ROOT / "engines/__init__.py").read_text(), True)
        for name in names
        if module.startswith("engines.")
    }
    assert exported() - {"register_tone_mapper"} <= defined


def test_dir_shows_the_public_names_and_nothing_else():
    script = "import engines, harness, engines.image, harness.store; print(dir(engines), dir(harness))"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{sorted(exported())} ['open_results']"


def test_the_top_level_is_the_fixed_one():
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=False)
    files = listed.stdout.splitlines() if listed.returncode == 0 else [path.name for path in ROOT.glob("[!.]*")]
    assert {Path(file).parts[0] for file in files} - TOP_LEVEL == set()


def test_every_module_says_what_lives_in_it():
    assert [name for name, path in MODULES.items() if not ast.get_docstring(ast.parse(path.read_text()))] == []


def test_no_file_is_longer_than_600_lines_without_a_reason():
    long = {
        str(path.relative_to(ROOT))
        for path in [*MODULES.values(), *ROOT.glob("tests/**/*.py")]
        if len(path.read_text().splitlines()) > 600
    }
    assert long == set(LONG_FILES)


def patches(source: str) -> list[str]:
    """Assignments to an attribute of something that a module imports, which is someone else's."""
    nodes = list(ast.walk(ast.parse(source)))
    imports = [node for node in nodes if isinstance(node, (ast.Import, ast.ImportFrom))]
    foreign = {(alias.asname or alias.name).partition(".")[0] for node in imports for alias in node.names}
    stored = [ast.unparse(n) for n in nodes if isinstance(n, ast.Attribute) and not isinstance(n.ctx, ast.Load)]
    return [target for target in stored if re.split(r"[.\[(]", target)[0] in foreign]


def test_no_module_assigns_to_an_attribute_of_what_it_imports():
    for_users = {"warnings.formatwarning", "config.CPU_NAME"}  # which Python's and Numba's documents tell programs to set
    found = {name: set(patches(path.read_text())) - for_users for name, path in MODULES.items()}
    assert {name: targets for name, targets in found.items() if targets} == {}
    assert patches("import a.b\nfrom c import d as e\na.b.c = 1\ne.x += 1\ndel a.x\nf.x = e.x") == ["a.b.c", "e.x", "a.x"]


def test_nothing_is_called_utils():
    words = {"utils", "util", "helpers", "misc", "common"}
    named = [path for path in ROOT.glob("[ehts]*/**/*") if path.stem in words and "__pycache__" not in path.parts]
    assert named == []


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from this tree and unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    built = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    (file,) = folder.glob("*.whl")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"


def test_a_wheel_holds_code_scenes_and_configs(wheel):
    held = {path.relative_to(wheel).as_posix() for path in wheel.rglob("*")}
    sources = [path for part in ("engines", "harness") for path in (ROOT / part).rglob("*.*")]
    assert {path.relative_to(ROOT).as_posix() for path in sources if "__pycache__" not in path.parts} <= held
    assert {"harness/_shipped/scenes/cornell_box.yaml", "harness/_shipped/configs/quick.yaml"} <= held
    assert {path.split("/")[0] for path in held if ".dist-info" not in path} == {"engines", "harness"}


def test_a_wheel_works_far_from_the_sources(wheel, tmp_path):
    script = "import engines, sys; sys.argv = ['raybench', 'list']; from harness.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={"PYTHONPATH": str(wheel), "PATH": "", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "cornell_box" in done.stdout
