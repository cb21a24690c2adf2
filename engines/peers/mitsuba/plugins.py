"""Integrators, BSDFs, samplers and other plugins for Mitsuba that the user has written in Python.

`module:function` names a function without arguments that registers them, as with `mitsuba.register_integrator`. The module is
imported with the engine's variant set, for each variant anew: a class that it defines derives from that variant's base class.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from engines.choices import Choice
from engines.errors import ConfigError, Unsupported
from engines.imports import imported
from engines.interface import Settings
from engines.peers.mitsuba.library import activate, one_line
from engines.source_files import INSTALLED

OWN = "plugin"
"""The option that names the function."""
_functions: dict[tuple[str, str], Callable[[], Any]] = {}


def node(options: Mapping[str, Any]) -> dict[str, Any]:
    """The plugin of a shader or sampler `mitsuba`: its `type` and its properties, those that are null left out."""
    return {key: value for key, value in options.items() if value is not None and key != OWN}


def named(settings: Settings) -> tuple[str, ...]:
    """The functions that resolved settings name, each once."""
    chosen: tuple[Choice, ...] = (settings.shader, settings.sampler)
    return tuple(dict.fromkeys(name for each in chosen if (name := each.options.get(OWN)) is not None))


def register(names: tuple[str, ...], variant: str, threads: int) -> None:
    """Calls the functions while `variant` is active: always again, as another plugin may have taken the type's name since.

    Raises `ConfigError` where one fails, and `Unsupported` where its module sets another variant.
    """
    for name in names:
        mi, _ = activate(variant, threads)
        try:
            if (variant, name) not in _functions:
                _functions[variant, name] = _imported(name)
            _functions[variant, name]()
        except ConfigError:
            raise
        except (Exception, SystemExit) as problem:
            message = f"{OWN} {name}: fails with {variant}: {type(problem).__name__}: {one_line(problem)}"
            raise ConfigError(message) from problem
        if (found := mi.variant()) != variant:
            activate(variant, threads)
            del _functions[variant, name]
            raise Unsupported(f"{name} sets Mitsuba's variant to {found}, and this engine has {variant}")


def _imported(name: str) -> Callable[[], Any]:
    """The function; what its module has imported from folders of the user's is imported again for another variant."""
    before = set(sys.modules)
    try:
        found = imported(name)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{OWN} {name}: cannot be imported: {one_line(error)}") from error
    for module in set(sys.modules) - before:
        file = getattr(sys.modules[module], "__file__", None)
        if file and not INSTALLED & set(Path(file).parts):
            del sys.modules[module]
    if not callable(found):
        raise ConfigError(f"{OWN} {name}: a function without arguments is expected")
    return found
