"""The code of engines and plugins as hashes, part of a cell's spec: results of an edited engine are outdated.

What the code of something imported is, `engines.source_files` says. An engine may name more in `source_files()`, as the
engine of a renderer's file does with the program's scripts. Where an engine runs in an environment that the user has
chosen, what is installed there counts as its code.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from engines.choices import Choice
from engines.errors import ConfigError
from engines.interface import Engine
from engines.registry import load_attribute
from engines.source_files import INSTALLED, OWN, code_files, digest, own_engine_files
from harness.hashing import digest as data_digest
from harness.settings import code_of


def engine_code(engine: Engine, name: str) -> str:
    """The hash of an engine's code; `name` is what the config calls it."""
    environment = environment_of(engine)
    engine = getattr(engine, "local", engine)  # that passes calls on to another process
    kind = type(engine)
    bases = [base.__module__ for base in kind.__mro__[1:]]
    # Base classes may come from large libraries, whose versions are those of the environment.
    modules = [*_own_modules(engine, name), *(base for base in bases if not _installed(base))]
    own = kind.__module__.partition(".")[0] == OWN.name
    files = digest([*(own_engine_files(kind.__module__) if own else code_files(_paths(modules))), *_named(engine)])
    return data_digest([files, environment]) if environment else files


def environment_of(engine: Engine) -> dict[str, str]:
    """What an engine says of the environment that the user has chosen for it: names and versions; empty for this process's."""
    return dict(getattr(engine, "environment", None) or {})


def plugin_codes(settings: Mapping[str, Any]) -> dict[str, str]:
    """Hashes of the code of plugins, `module:attribute`, among a cell's choices: a changed file is another request."""
    chosen = [Choice.of(value) for value in settings.values() if isinstance(value, Mapping)]
    return {name: _code_at(name, given) for given in chosen for name in code_of(given)}


def _code_at(name: str, given: Choice) -> str:
    """The hash of the code of a choice's plugin; what the choice's engine imports is not imported here."""
    if name == given.name:
        return plugin_code(load_attribute(name), name)
    module = name.partition(":")[0]
    try:
        found = find_spec(module)
    except (ImportError, ValueError) as error:
        raise ConfigError(f"{name}: cannot be found: {error}") from error
    if found is None or not found.origin:
        raise ConfigError(f"{name}: there is no module {module} beside the file that names it or in the working directory")
    return digest(code_files([Path(found.origin)]))


def plugin_code(plugin: Any, name: str) -> str:
    """The hash of the code of a plugin, `module:attribute`."""
    return digest(code_files(path for path in _paths(_own_modules(plugin, name)) if not path.is_relative_to(OWN)))


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
        message = f"engine {engine.name}: source_files failed: {type(error).__name__}: {error}: paths are expected"
        raise ConfigError(message) from error
    for file in files:
        yield file.name, file
        if file.suffix == ".py":
            yield from code_files([file])
