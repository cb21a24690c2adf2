"""From a name to an engine: the entry-point group `raybench.engines`, ours built in, or `module:attribute`."""

from __future__ import annotations

import importlib
import warnings
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from engines.errors import ConfigError, UnknownName
from engines.interface import Engine

GROUP = "raybench.engines"
BUILT_IN = {
    "numpy": "engines.numpy_reference:Engine",
    "numba": "engines.numba_cpu:Engine",
    "embree": "engines.embree:Engine",
}


def engine_names() -> list[str]:
    """Names of the engines that can be asked for, ours first; nothing is imported."""
    plugins = {point.name for point in _entry_points()} - BUILT_IN.keys()
    return [*BUILT_IN, *sorted(plugins)]


def engine(name: Any) -> Engine:
    """The engine of a name or `module:attribute`; an engine object is returned as it is.

    Raises `UnknownName` for a name no one registered, `ConfigError` when the engine cannot be imported.
    """
    if not isinstance(name, str):
        return name() if isinstance(name, type) else name
    if ":" in name:
        return _made(load_attribute(name), name)
    if name in BUILT_IN:
        return _made(load_attribute(BUILT_IN[name]), name)
    for point in _entry_points():
        if point.name == name:
            try:
                return _made(point.load(), name)
            except Exception as error:
                raise ConfigError(f"engine {name!r} ({point.value}): cannot be loaded: {error}") from error
    raise UnknownName("engine", name, engine_names())


def load_attribute(path: str) -> Any:
    """The object at `module:attribute`; raises `ConfigError` where there is none."""
    module, _, attribute = path.partition(":")
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except Exception as error:
        raise ConfigError(f"{path}: cannot be imported: {error}") from error
    return found


def _made(found: Any, name: str) -> Engine:
    try:
        return found() if isinstance(found, type) else found
    except Exception as error:
        raise ConfigError(f"engine {name!r}: cannot be created: {error}") from error


def _entry_points() -> list[EntryPoint]:
    seen: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        if point.name in seen and seen[point.name].value != point.value:
            warnings.warn(f"engine {point.name!r} is registered twice: {seen[point.name].value} is used", stacklevel=3)
        seen.setdefault(point.name, point)
    return list(seen.values())
