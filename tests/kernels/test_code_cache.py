"""The disk cache of machine code gives each process the code of its key, or none."""

import ast
import enum
import importlib
import inspect
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import pytest

from engines.kernels.compile import code_cache
from engines.kernels.compile.code_cache import COMPILED, KeyedFiles, hash_of_sources

ENGINES = Path(code_cache.__file__).parents[2]
KEY, OTHER = ("void(int64, int64)", "cpu", "stage 4"), ("void(int64, int64)", "cpu", "stage 14")


def test_each_key_has_a_file_of_its_own_whoever_writes_first(tmp_path):
    one, two = KeyedFiles(tmp_path, "stage"), KeyedFiles(tmp_path, "stage")
    assert one.load(KEY) is None and two.load(OTHER) is None
    one.save(KEY, b"4")
    two.save(OTHER, b"14")
    for files in (one, two, KeyedFiles(tmp_path, "stage")):
        assert (files.load(KEY), files.load(OTHER)) == (b"4", b"14")
    assert len(list(tmp_path.iterdir())) == 2


def test_code_of_another_key_is_not_believed(tmp_path):
    files = KeyedFiles(tmp_path, "stage")
    files.save(OTHER, b"14")
    shutil.copy(files.path(OTHER), files.path(KEY))
    assert files.load(KEY) is None
    files.save(KEY, b"4")
    assert files.load(KEY) == b"4"


@pytest.mark.parametrize("damage", ["empty", "truncated", "a bit", "another format", "a folder", "nothing but a pickle"])
def test_a_damaged_file_is_a_miss(tmp_path, damage):
    files = KeyedFiles(tmp_path, "stage")
    files.save(KEY, b"machine code" * 100)
    path, content = files.path(KEY), files.path(KEY).read_bytes()
    changed = {
        "empty": b"",
        "truncated": content[:-1],
        "a bit": content[:-40] + bytes([content[-40] ^ 1]) + content[-39:],
        "another format": b"x" + content[1:],
        "a folder": None,
        "nothing but a pickle": content[56:],
    }[damage]
    path.unlink()
    path.mkdir() if changed is None else path.write_bytes(changed)
    assert files.load(KEY) is None
    files.save(KEY, b"4")
    assert files.load(KEY) == (None if changed is None else b"4")


def test_a_folder_that_cannot_be_written_keeps_nothing_and_raises_nothing(tmp_path):
    files = KeyedFiles(tmp_path / "gone", "stage")
    files.save(KEY, b"4")
    assert files.load(KEY) is None


def is_compiled(path):
    return path.relative_to(ENGINES).parts[0] in COMPILED


def test_the_sources_of_kernels_count_and_no_others(tmp_path):
    copy = tmp_path / "engines"
    shutil.copytree(ENGINES, copy, ignore=shutil.ignore_patterns("__pycache__"))
    whole = hash_of_sources(copy)
    assert whole == hash_of_sources(ENGINES)
    for original in (ENGINES / "choices.py", *(ENGINES / "kernels").rglob("*.py"), *(ENGINES / "scene").glob("*.py")):
        path = copy / original.relative_to(ENGINES)
        source = path.read_bytes()
        path.write_bytes(source + b"SPHERE = 99\n")
        assert (hash_of_sources(copy) != whole) == is_compiled(original), path
        path.write_bytes(source)
    assert hash_of_sources(copy) == whole


def test_every_module_that_compiles_counts():
    compiler = re.compile(r"(numba|llvmlite|engines\.kernels\.compile|engines\.plugin)\b")
    compiling = [
        path
        for path in ENGINES.rglob("*.py")
        if compiler.search(path.read_text()) and any(map(compiler.match, imported_modules(path)))
    ]
    assert len(compiling) > 50 and all(map(is_compiled, compiling))


def imported_modules(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_kernels_take_classes_and_python_functions_alone_from_other_modules():
    """A number or an array of theirs could be frozen into machine code that no hash names."""
    taken = [each for path in ENGINES.rglob("*.py") if is_compiled(path) for each in taken_from_others(path)]
    assert len(taken) > 50
    assert [where for where, value in taken if not is_class_or_python_function(value)] == []


def taken_from_others(path):
    """Where, and what, a module of kernels takes from modules of `engines` that are not hashed."""
    tree = ast.parse(path.read_text())
    whole = {}  # names of imported modules
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("engines") for alias in node.names), path
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("engines"):
            continue
        for alias in node.names:
            module = importlib.import_module(node.module)
            inner = f"{node.module}.{alias.name}"
            value = getattr(module, alias.name) if hasattr(module, alias.name) else importlib.import_module(inner)
            if inspect.ismodule(value):
                whole[alias.asname or alias.name] = value
            elif not is_compiled(Path(module.__file__)):
                yield f"{path.name}: {alias.name}", value
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in whole:
            module = whole[node.value.id]
            if not is_compiled(Path(module.__file__)):
                yield f"{path.name}: {node.value.id}.{node.attr}", getattr(module, node.attr)


def is_class_or_python_function(value):
    is_type = inspect.isclass(value) and not issubclass(value, enum.Enum)
    return is_type or inspect.isfunction(value) or typing.get_origin(value) is not None


STAGES = """
import random, sys
from engines.kernels.compile.jit import compile_stage
from engines.kernels.compile.memory import array_at
import numpy as np
def make(k):
    def stage(batch, scene):
        array_at(batch, np.int64)[0] = k
    return stage
wanted = list(range(12))
random.Random(int(sys.argv[1])).shuffle(wanted)
place = np.zeros(1, np.int64)
for k in wanted:
    compiled = compile_stage(make(k))
    compiled.ctypes(place.ctypes.data, 0)
    assert place[0] == k, f"stage {k} gave {place[0]}"
"""


def test_processes_that_compile_at_once_get_the_code_they_asked_for(tmp_path):
    (tmp_path / "stages.py").write_text(STAGES)
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ENGINES.parent)}
    programs = [
        subprocess.Popen([sys.executable, str(tmp_path / "stages.py"), str(k)], env=environment, stderr=subprocess.PIPE)
        for k in range(4)
    ]
    for program in programs:
        _, error = program.communicate(timeout=300)
        assert program.returncode == 0, error.decode()
    files = list((tmp_path / "cache").rglob("*.code"))
    assert len([path for path in files if "stage" in path.name]) == 12
    damaged = files[0]
    damaged.write_bytes(damaged.read_bytes()[:100])
    last = subprocess.run([sys.executable, str(tmp_path / "stages.py"), "9"], env=environment, check=False)
    assert last.returncode == 0 and damaged.stat().st_size > 100
