"""The code of engines and plugins as hashes, part of a cell's spec: results of an edited engine are outdated.

The code of something imported is all of the package that it is defined in, native libraries included, or its one file;
where that is not installed in site-packages, also what it imports from the folder beside. An engine may name more in
`source_files()`, as the engine of a renderer's file does with the program's scripts.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import engines
from engines.errors import ConfigError
from engines.interface import Engine

SUFFIXES = (".py", ".so", ".pyd", ".dll", ".dylib")
LARGEST = 1 << 28
"""Bytes; of a larger file only the size is looked at."""
INSTALLED = {"site-packages", "dist-packages"}
OWN = Path(engines.__file__).resolve().parent
_IMPORTED = re.compile(rb"^[ \t]*(?:from[ \t]+(\w+)[\w.]*[ \t]+import\b|import[ \t]+([\w., \t]+))", re.MULTILINE)


def engine_code(engine: Engine, name: str) -> str:
    """The hash of an engine's code; `name` is what the config calls it."""
    kind = type(engine)
    bases = [base.__module__ for base in kind.__mro__[1:]]
    # Base classes may come from large libraries, whose versions are those of the environment.
    modules = [*_own_modules(engine, name), *(base for base in bases if not _installed(base))]
    return _digest([*_files(_paths(modules)), *_named(engine)])


def plugin_code(plugin: Any, name: str) -> str:
    """The hash of the code of a plugin, `module:attribute`."""
    return _digest(_files(path for path in _paths(_own_modules(plugin, name)) if not path.is_relative_to(OWN)))


def _own_modules(found: Any, name: str) -> list[str]:
    """The module that `name` names and the one that a thing is defined in."""
    module, colon, _ = name.partition(":")
    defined = found.__name__ if inspect.ismodule(found) else getattr(found, "__module__", type(found).__module__)
    return [*([module] if colon else []), str(defined)]


def _paths(modules: Iterable[str]) -> list[Path]:
    """The files of modules, those of Python itself left out."""
    outside = [name for name in dict.fromkeys(modules) if name.partition(".")[0] not in sys.stdlib_module_names]
    files = [getattr(sys.modules.get(name), "__file__", None) for name in outside]
    return [Path(file).resolve() for file in files if file]


def _installed(module: str) -> bool:
    return any(INSTALLED & set(path.parts) for path in _paths([module]))


def _named(engine: Engine) -> Iterator[tuple[str, Path]]:
    """What an engine names itself; the folders of its files are no part of its code."""
    given: Any = getattr(engine, "source_files", None)
    try:
        answer: Any = given() if callable(given) else ()
        files = [Path(file) for file in answer]
    except (Exception, SystemExit) as error:
        message = f"engine {engine.name}: source_files failed: {type(error).__name__}: {error}: paths are wanted"
        raise ConfigError(message) from error
    for file in files:
        yield file.name, file
        if file.suffix == ".py":
            yield from _files([file])


def _files(modules: Iterable[Path]) -> list[tuple[str, Path]]:
    """(name, file) of all that makes up the code of modules, sorted; a name is the path from beside the package."""
    found: dict[Path, str] = {}
    waiting = [_root(module) for module in modules]
    seen = set()
    while waiting:
        root = waiting.pop()
        if root in seen:
            continue
        seen.add(root)
        beside = root.parent
        for file in _below(root):
            found[file] = file.relative_to(beside).as_posix()
            if file.suffix == ".py" and root != OWN and beside.name not in INSTALLED:
                waiting += [_root(path) for path in _imported(file, beside)]
    return sorted((name, file) for file, name in found.items())


def _root(file: Path) -> Path:
    """The outermost package that holds a module, or the module's own file."""
    root = file = file.resolve()
    folder = file.parent
    while (folder / "__init__.py").is_file():
        root, folder = folder, folder.parent
    return root


def _below(root: Path) -> Iterator[Path]:
    """The files of code in a package, or the one file."""
    if root.is_file():
        yield root
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if name != "__pycache__" and not name.startswith("."))
        yield from (Path(folder, name) for name in sorted(names) if name.endswith(SUFFIXES))


def _imported(file: Path, beside: Path) -> Iterator[Path]:
    """The files of modules in the folder `beside` that a file imports by name."""
    for first, several in _IMPORTED.findall(_bytes(file)):
        words = (
            [first] if first else [part.split()[0].partition(b".")[0] for part in several.split(b",") if part.split()]
        )
        for word in words:
            for path in (beside / f"{word.decode()}.py", beside / word.decode() / "__init__.py"):
                if path.is_file() and not path.resolve().is_relative_to(OWN):
                    yield path


def _digest(files: Iterable[tuple[str, Path]]) -> str:
    total = hashlib.sha256()
    for name, file in sorted(set(files)):
        size = file.stat().st_size if file.is_file() else -1
        content = hashlib.sha256(_bytes(file) if 0 <= size <= LARGEST else str(size).encode())
        total.update(f"{name}\0{content.hexdigest()}\n".encode())
    return total.hexdigest()


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""
