"""The files that make up the code of a module, and their hash.

They are all of the package that the module is in, native libraries included, or its one file; where that is not installed in
site-packages, also what it imports by name from the folder beside, transitively.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

SUFFIXES = (".py", ".so", ".pyd", ".dll", ".dylib")
LARGEST = 1 << 28
"""Bytes; of a larger file only the size is looked at."""
INSTALLED = {"site-packages", "dist-packages"}
OWN = Path(__file__).resolve().parent
"""The package `engines`."""
_IMPORTED = re.compile(rb"^[ \t]*(?:from[ \t]+(\w+)[\w.]*[ \t]+import\b|import[ \t]+([\w., \t]+))", re.MULTILINE)


def code_files(modules: Iterable[Path]) -> list[tuple[str, Path]]:
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


def digest(files: Iterable[tuple[str, Path]]) -> str:
    """The hash of (name, file), whatever their order."""
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
