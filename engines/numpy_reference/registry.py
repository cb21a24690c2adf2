"""How a package knows its models: each module of its folder has a table of its own, and no list of modules is kept."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable
from typing import Any


def collect(table: str, package: str, folder: Iterable[str]) -> dict[type, Any]:
    """The tables of this name in the modules of a package, joined in the order of the modules' names.

    `package` and `folder` are the package's `__name__` and `__path__`. A module may have no such table. Raises
    `ValueError` where two have the same type.
    """
    found: dict[type, Any] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(folder, f"{package}.")):
        for kind, model in getattr(importlib.import_module(name), table, {}).items():
            if kind in found:
                raise ValueError(f"{name}.{table}: {kind.__name__} has a model already, {found[kind].__qualname__}")
            found[kind] = model
    return found
