"""The files that make up the code of a module, and their hash.

They are all of the package that the module is in, native libraries included, or its one file; where that is not installed in
site-packages, also what it imports by name from the folder beside, transitively. Of raybench's own `engines` they can be
limited to what one of its engines uses (`own_engine_files`), so that editing one engine leaves the results of the others.
"""

from __future__ import annotations

import functools
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
SHARED = ("__init__.py", "registry.py", "peers/isolated")
"""Parts of `engines` that belong to every engine: what makes one of a name, and the process that one may run in."""
_IMPORTED = re.compile(rb"^[ \t]*(?:from[ \t]+(\w+)[\w.]*[ \t]+import\b|import[ \t]+([\w., \t]+))", re.MULTILINE)

_OWN_IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+(engines(?:\.\w+)*)[ \t]+import[ \t]*(\([^)]*\)|[^\n]*)|import[ \t]+(engines\b[^\n]*))", re.MULTILINE
)
_COMMENT = re.compile(rb"#[^\n]*")


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


def own_engine_files(module: str, package: Path = OWN) -> list[tuple[str, Path]]:
    """(name, file) of the code of an engine of raybench's own: its part of `engines` and all parts that these import.

    A part is a file or folder of `engines`; of `peers` each folder is one. Imports count wherever they stand in a file. What is
    loaded by a name in a text does not: `SHARED` has it.
    """
    needed: set[str] = set()
    waiting = [_part(module.split(".")[1:], package), *SHARED]
    while waiting:
        part = waiting.pop()
        if part not in needed:
            needed.add(part)
            waiting += _imported_parts(package / part, package)
    files = [file for part in needed for file in _below(package / part)]
    return sorted((f"engines/{file.relative_to(package).as_posix()}", file) for file in files)


def _part(names: list[str], package: Path) -> str:
    """The part of `engines` that holds a module, or an attribute of the package: `kernels`, `film.py`, `peers/cycles`."""
    if len(names) > 1 and names[0] == "peers":
        return f"peers/{names[1]}"
    if names and (package / names[0]).is_dir():
        return names[0]
    return f"{names[0]}.py" if names and (package / f"{names[0]}.py").is_file() else "__init__.py"


@functools.cache
def _imported_parts(part: Path, package: Path) -> frozenset[str]:
    """The parts that the files of a part import."""
    found = set()
    for file in _below(part):
        if file.suffix == ".py":
            found.update(_part(name.split(".")[1:], package) for name in _imported_names(_bytes(file)))
    return frozenset(found)


def _imported_names(code: bytes) -> Iterator[str]:
    """Full names of what a file imports from `engines`; relative imports are not used there. Read by a pattern, since a worker
    waits for it and parsing takes ten times as long; a line of a text that looks like an import counts as one."""
    for module, several, plain in _OWN_IMPORT.findall(code):
        names = [part.split()[0] for part in _COMMENT.sub(b"", several or plain).strip(b"()").split(b",") if part.split()]
        yield from (f"{module.decode()}.{name.decode()}" if module else name.decode() for name in names)


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
        words = [first] if first else [part.split()[0].partition(b".")[0] for part in several.split(b",") if part.split()]
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
