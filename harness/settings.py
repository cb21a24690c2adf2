"""The settings with which an engine renders a cell or traces its rays: one type each in plans and requests of workers, whose
fields events have too; and what an engine gets.

A choice named `module:attribute` is code of the user's. It is imported only when imports are allowed, and is then the plugin
object itself, some of whose options the choice changes, or a class or function called with the options.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engines import choices
from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, UnknownName
from engines.interface import Settings
from engines.registry import load_attribute, names_a_program

CHOICES = ("shader", "sampler", "accelerator")
"""Settings that have options."""


@dataclass(frozen=True, slots=True)
class TracerSettings:
    """What an engine is told about a cell that traces rays, beside the scene: `precision` is float64, float32, or None for the
    engine's own; the accelerator has all of its options."""

    accelerator: Choice
    precision: str | None
    threads: int

    def fields(self) -> dict[str, Any]:
        """The settings by their names."""
        return {key: getattr(self, key) for key in self.__dataclass_fields__}

    def describe(self) -> dict[str, Any]:
        """Plain data, as specs hold it."""
        return {key: value.describe() if key in CHOICES else value for key, value in self.fields().items()}


@dataclass(frozen=True, slots=True)
class CellSettings(TracerSettings):
    """What an engine is told about a cell that renders, beside scene and seed; `precision` is never None in a plan. `width` and
    `height` are in pixels; a choice has all of its options."""

    shader: Choice
    sampler: Choice
    width: int
    height: int


def engine_settings(settings: CellSettings, seed: int, allow_imports: bool) -> Settings:
    """What an engine is given for a cell with this seed."""
    return Settings(
        **{kind: plugin_or_choice(kind, getattr(settings, kind), allow_imports) for kind in CHOICES},
        width=settings.width,
        height=settings.height,
        threads=settings.threads,
        precision=settings.precision,
        seed=seed,
    )


def plugin_or_choice(kind: str, given: Choice, allow_imports: bool) -> Any:
    """The choice as plain data, or for `module:attribute` the plugin that it names, with its options."""
    if ":" in given.name:
        return _plugin(kind, given, allow_imports)[0]
    for name in code_of(given):
        require_imports(name, allow_imports)
    return given.describe()


def code_of(given: Choice) -> list[str]:
    """The `module:attribute` that a choice names: itself, or its option `plugin`, which its engine imports."""
    return [name for name in (given.name, given.options.get("plugin")) if isinstance(name, str) and ":" in name]


def completed(kind: str, given: Choice, allow_imports: bool) -> Choice:
    """A choice with all options of the plugin that it names: what identifies it, whether or not defaults are written."""
    return Choice(given.name, _plugin(kind, given, allow_imports)[1]) if ":" in given.name else given


def _plugin(kind: str, given: Choice, allow_imports: bool) -> tuple[Any, dict[str, Any]]:
    """What an engine gets for a `module:attribute`, and its options."""
    name, options = given.name, dict(given.options)
    require_imports(name, allow_imports)
    found = load_attribute(name)
    if isinstance(found, type) or (callable(found) and not hasattr(found, "name")):
        try:
            if inspect.signature(found).parameters:
                options = _arguments(f"{kind} {name!r}", found, options)
                return found(**options), options
            found = found()  # whose own `options` are changed
        except RaybenchError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigError(f"{kind} {name}: cannot be created: {type(error).__name__}: {error}") from error
    if not isinstance(getattr(found, "name", None), str):
        raise ConfigError(f"{kind} {name}: is of type {type(found).__name__}: an object with a `name` is expected")
    choice = choices.resolve(kind, {"name": found, **options}, {})
    return choice, dict(choice.options)


def _arguments(what: str, make: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a class or function that makes a plugin: `options`, and defaults for those that are left out."""
    parameters = list(inspect.signature(make).parameters.values())
    known = {each.name: each.default for each in parameters if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)}
    for key in options:
        if key not in known and not any(each.kind is each.VAR_KEYWORD for each in parameters):
            raise UnknownName(f"option of {what}", key, known)
    for key, default in known.items():
        if default is inspect.Parameter.empty and key not in options:
            raise ConfigError(f"{what}: the option {key!r} is missing")
    numbers = {key: value.item() if isinstance(value, np.generic) else value for key, value in known.items()}
    plain = {key: value for key, value in numbers.items() if isinstance(value, (bool, int, float, str, type(None)))}
    return {**plain, **options}


def require_commands(name: str, allowed: bool) -> None:
    """Refuses an engine that is a program, or for which one is named, unless that was allowed on the command line."""
    if names_a_program(name) and not allowed:
        raise ConfigError(f"{name}: names a program to be run; run with --allow-commands if you trust it")


def require_imports(name: str, allowed: bool) -> None:
    """Refuses a name that would run the user's code unless that was allowed on the command line."""
    if ":" in name and not allowed:
        raise ConfigError(f"{name}: names code to be imported; run with --allow-imports if you trust it")
