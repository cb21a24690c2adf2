"""From a name to an engine: the entry-point group `raybench.engines`, ours built in, or `module:attribute`.

A name that ends in .yaml or .yml is the file of a renderer that runs as a process: see `engines.external`.
"""

from __future__ import annotations

import importlib
import warnings
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from engines.errors import ConfigError, RaybenchError, UnknownName
from engines.interface import Engine

GROUP = "raybench.engines"
_PARTS = ("name", "version", "why_not", "prepare", "accelerators")

BUILT_IN = {
    "numpy": "engines.numpy_reference:Engine",
    "numba": "engines.numba_cpu:Engine",
    "embree": "engines.embree:Engine",
    "embreex_batch": "engines.embreex_batch:Engine",
}

SPECIAL = {"dahlquist": "engines.dahlquist.engine:Engine"}
"""Engines that render one scene alone: asked for by name, but not among those that render any."""


def engine_names() -> list[str]:
    """Names of the engines that can be asked for, ours first; nothing is imported."""
    return [*BUILT_IN, *sorted(point.name for point in _entry_points())]


def known_names() -> list[str]:
    """All names that `engine` knows."""
    return [*engine_names(), *SPECIAL]


def engine(name: Any) -> Engine:
    """The engine of a name, `module:attribute` or renderer's file; an object is returned as it is, a class is called.

    Raises `UnknownName` for a name no one registered, `ConfigError` where what is there cannot be loaded or is none.
    """
    if not isinstance(name, str):
        return _made(name, getattr(name, "name", name))
    if is_file(name):
        return _described(name)
    if ":" in name:
        return _made(load_attribute(name), name)
    if name in (ours := BUILT_IN | SPECIAL):
        return _made(load_attribute(ours[name]), name)
    for point in _entry_points():
        if point.name == name:
            try:
                found = point.load()
            except (Exception, SystemExit) as error:
                raise ConfigError(f"engine {name!r} ({point.value}): cannot be loaded: {error}") from error
            return _made(found, name)
    raise UnknownName("engine", name, known_names())


def lineage_of(engine: Engine) -> str:
    """What an engine shares its code with, and so its errors: its attribute `lineage`, or its own name."""
    return str(getattr(engine, "lineage", engine.name))


def all_engines() -> list[Engine]:
    """Every engine that can be had by name; one that cannot is left out with a warning that says why."""
    found = []
    for name in engine_names():
        try:
            made = engine(name)
            made.accelerators()
            found.append(made)
        except RaybenchError as error:
            warnings.warn(f"{error}: it is left out", stacklevel=2)
        except Exception as error:  # what others wrote may fail in any way
            warnings.warn(f"engine {name!r}: {type(error).__name__}: {error}: it is left out", stacklevel=2)
    return found


def is_file(name: str) -> bool:
    """Whether an engine's name is the file of a renderer."""
    return name.endswith((".yaml", ".yml"))


def _described(path: str) -> Engine:
    made = load_attribute("engines.external:Engine")(path)
    if made.name in engine_names():
        raise ConfigError(f"{path}: name = {made.name!r}: is that of an engine: call the renderer something else")
    return made


def load_attribute(path: str) -> Any:
    """The object at `module:attribute`; raises `ConfigError` where there is none."""
    module, _, attribute = path.partition(":")
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{path}: cannot be imported: {error}") from error
    return found


def _made(found: Any, name: object) -> Engine:
    try:
        made = found() if isinstance(found, type) else found
    except (Exception, SystemExit) as error:
        raise ConfigError(f"engine {name!r}: cannot be created: {error}") from error
    try:
        lacking = [part for part in _PARTS if not hasattr(made, part)]
    except Exception as error:
        raise ConfigError(f"engine {name!r}: {found!r} is no engine: it fails when it is asked: {error}") from error
    if lacking:
        raise ConfigError(f"engine {name!r}: {found!r} is no engine: it lacks {', '.join(lacking)}")
    if not isinstance(made.name, str) or not made.name.isprintable() or not made.name.strip():
        raise ConfigError(f"engine {name!r}: its name is {made.name!r}: a line of text is wanted")
    lineage = getattr(made, "lineage", made.name)
    if not isinstance(lineage, str) or not lineage.isprintable() or not lineage.strip():
        raise ConfigError(f"engine {name!r}: its lineage is {lineage!r}: a line of text is wanted")
    return made


def _entry_points() -> list[EntryPoint]:
    """The plugins' entry points, one a name; raybench's own are left out, as the built-in table has them."""
    plugins: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        used = BUILT_IN.get(point.name) or plugins.setdefault(point.name, point).value
        if used != point.value:
            warnings.warn(f"engine {point.name!r} is registered twice: {used} is used", stacklevel=3)
    return list(plugins.values())
