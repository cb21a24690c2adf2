"""Code of the user's, named `module:attribute`: found beside the file that names it, then where Python looks.

It imports the standard library only.
"""

from __future__ import annotations

import importlib
import os
import site
import sys
from importlib.machinery import PathFinder
from os import PathLike
from pathlib import Path
from typing import Any


def imported(name: str, folder: str | PathLike[str] | None = None) -> Any:
    """The object at `module:attribute`. Its module is looked for in `folder`, that of the file that names it, first.

    Raises whatever the import raises, and `ImportError` where another module of that name has been imported from elsewhere.
    """
    module, _, attribute = name.partition(":")
    beside = None if folder is None else os.path.abspath(folder)
    if beside is not None:
        sys.path.insert(0, beside)
    try:
        there = _found(module.partition(".")[0])
        found: Any = importlib.import_module(module)
    finally:
        if beside in sys.path:
            sys.path.remove(beside)  # what the module itself has changed there stays
    if beside and beside not in sys.path and there and Path(there).is_relative_to(beside):
        sys.path.append(beside)  # where the code may import more, later and in processes that get it
    for part in attribute.split("."):
        found = getattr(found, part)
    return found


def _found(package: str) -> str | None:
    """The file of the package that Python would find now, where it has one; refused if another has been imported."""
    spec = PathFinder.find_spec(package)
    there = getattr(sys.modules.get(package), "__file__", None)
    if spec is None or not spec.origin:
        return None
    if there and os.path.realpath(there) != os.path.realpath(spec.origin):
        raise ImportError(f"{spec.origin} has the name of a module that is in use, {there}: rename one")
    return spec.origin


def users_folders() -> list[str]:
    """The folders of `sys.path` that belong to no installation of Python: where code of the user's lies."""
    installed = {sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix, site.getusersitepackages()}
    folders = [os.path.abspath(folder) for folder in sys.path]
    return [folder for folder in folders if not any(Path(folder).is_relative_to(each) for each in installed)]
