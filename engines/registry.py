"""From a name to an engine: the entry-point group `raybench.engines`, ours built in, or `module:attribute`.

A name that ends in .yaml or .yml is the file of a renderer that runs as a process: see `engines.peers.external`. What follows
an @ is the Python that runs the engine, `mitsuba@/path/to/environment`: see `engines.peers.isolated`.
"""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from engines.errors import ConfigError, UnknownName
from engines.imports import imported
from engines.interface import Engine

GROUP = "raybench.engines"
_PARTS = ("name", "version", "why_not", "prepare", "accelerators")

BUILT_IN = {
    "numpy": "engines.numpy_reference:Engine",
    "numba": "engines.numba_cpu:Engine",
    "embree": "engines.embree:Engine",
    "embreex_batch": "engines.embreex_batch:Engine",
}

THIS = "this"
"""The Python that runs this process, where one is named."""

SPECIAL = {"dahlquist": "engines.dahlquist.engine:Engine"}
"""Engines that render one scene alone: asked for by name, but not among those that render any."""


def engine_names() -> list[str]:
    """Names of the engines that can be asked for, ours first; nothing is imported."""
    return [*BUILT_IN, *sorted(point.name for point in _entry_points())]


def known_names() -> list[str]:
    """All names that `engine` knows."""
    return [*engine_names(), *SPECIAL]


def engine(name: Any) -> Engine:
    """The engine of a name, `module:attribute` or renderer's file; an object is returned as it is, a class is called, and of a
    function `from_function` makes an engine.

    A name may be followed by @ and a Python, see `interpreter`. An engine with such a one, and one whose class has
    `own_process = True`, runs in a process of its own.

    Raises `UnknownName` for a name no one registered, `ConfigError` where what is there cannot be loaded or is none.
    """
    if not isinstance(name, str):
        return _made(name, getattr(name, "name", name))
    if is_file(name):
        return _described(name)
    base, python = split(name)
    made = _made(_loaded(base), base)
    if python is None and not getattr(made, "own_process", False):
        return made
    apart = load_attribute("engines.peers.isolated:Engine")
    variable = f"RAYBENCH_{re.sub('[^A-Z0-9]', '_', made.name.upper())}_PYTHON"
    named = python or os.environ.get(variable)
    return apart(made, place(base), interpreter(named or THIS), bool(named))


def make(place: str) -> Engine:
    """The engine at `module:attribute`, in this process even where it asks for one of its own."""
    return _made(load_attribute(place), place)


def from_function(render: Callable[..., Any], name: str = "", version: str = "1") -> Engine:
    """The engine of a function `render(scene, settings, spp, seed)`, which returns the mean of `spp` samples per pixel as an
    array (h, w, 3) of linear radiance, row 0 at the top.

    `settings` have every choice resolved; `settings.size(scene)` is width and height. `seed`, in [1, 2^31), is another one in
    every call. The function raises `Unsupported` with a sentence for what it cannot render. `name` is by default that of the
    function. Change `version` when its images or speed may change.
    """
    named = name or getattr(render, "__name__", type(render).__name__)
    made: Engine = load_attribute("engines.peers.function:FunctionEngine")(render, named, version)
    return made


def split(name: str) -> tuple[str, str | None]:
    """An engine's name without the Python that is to run it, and that Python, or None."""
    base, sign, python = (name, "", "") if is_file(name) else name.partition("@")
    return base, python if sign else None


def names_a_program(name: str) -> bool:
    """Whether an engine's name says what is to be run: a renderer's file, or a Python other than this one."""
    return is_file(name) or split(name)[1] not in (None, THIS)


def is_known(name: str) -> bool:
    """Whether `engine` would look for more than a name that nobody has registered."""
    return is_file(name) or ":" in name or split(name)[0] in known_names()


def interpreter(text: str) -> str:
    """The path of a Python: that of an environment's folder, an interpreter, or `this` one. Raises `ConfigError`."""
    if text == THIS:
        return sys.executable
    path = os.path.abspath(os.path.expanduser(text))
    if os.path.isdir(path):
        inside = [os.path.join(path, *words) for words in (("bin", "python"), ("Scripts", "python.exe"))]
        found = next(filter(os.path.isfile, inside), None)
        if found is None:
            raise ConfigError(f"{text}: there is no bin/python in it: the folder of a virtual environment is expected")
        return found
    if not os.path.isfile(path):
        raise ConfigError(f"{text}: does not exist: the folder of a virtual environment, or a Python, is expected")
    if not os.access(path, os.X_OK):
        raise ConfigError(f"{text}: is no program: the folder of a virtual environment, or a Python, is expected")
    return path


def place(name: str) -> str:
    """The `module:attribute` of an engine's name. Raises `UnknownName`."""
    if ":" in name:
        return name
    known = {point.name: point.value for point in _entry_points()} | BUILT_IN | SPECIAL
    if name not in known:
        raise UnknownName("engine", name, known_names())
    return known[name]


def _loaded(name: str) -> Any:
    """What lies at the place of a name."""
    if ":" in name or name in BUILT_IN | SPECIAL:
        return load_attribute(place(name))
    for point in _entry_points():
        if point.name == name:
            try:
                return point.load()
            except (Exception, SystemExit) as error:
                raise ConfigError(f"engine {name!r} ({point.value}): cannot be loaded: {error}") from error
    raise UnknownName("engine", name, known_names())


def lineage_of(engine: Engine) -> str:
    """What an engine shares its code with, and so its errors: its attribute `lineage`, or its own name."""
    return str(getattr(engine, "lineage", engine.name))


def is_file(name: str) -> bool:
    """Whether an engine's name is the file of a renderer."""
    return name.endswith((".yaml", ".yml"))


def _described(path: str) -> Engine:
    made = load_attribute("engines.peers.external:Engine")(path)
    if made.name in engine_names():
        raise ConfigError(f"{path}: name = {made.name!r}: is that of an engine: call the renderer something else")
    return made


def load_attribute(path: str) -> Any:
    """The object at `module:attribute`; raises `ConfigError` where there is none."""
    try:
        return imported(path)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{path}: cannot be imported: {error}") from error


def _made(found: Any, name: object) -> Engine:
    if _is_function(found):
        return from_function(found, name.replace(":", ".") if isinstance(name, str) else "")
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
        raise ConfigError(f"engine {name!r}: its name is {made.name!r}: a line of text is expected")
    lineage = getattr(made, "lineage", made.name)
    if not isinstance(lineage, str) or not lineage.isprintable() or not lineage.strip():
        raise ConfigError(f"engine {name!r}: its lineage is {lineage!r}: a line of text is expected")
    return made


def _is_function(found: Any) -> bool:
    """Whether something can be called that is neither a class nor an engine."""
    return callable(found) and not isinstance(found, type) and not hasattr(found, "prepare")


def _entry_points() -> list[EntryPoint]:
    """The plugins' entry points, one a name; raybench's own are left out, as the built-in table has them."""
    plugins: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        used = BUILT_IN.get(point.name) or plugins.setdefault(point.name, point).value
        if used != point.value:
            warnings.warn(f"engine {point.name!r} is registered twice: {used} is used", stacklevel=3)
    return list(plugins.values())
