"""Names and options of shaders, samplers and accelerators: one table, read by every engine, `raybench list` and docs.

A choice is written as a name, as `{name: ..., option: value}`, or as a plugin object (anything with a `name`), which in Python
may also stand as the name of a mapping with options.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from engines.errors import ConfigError, UnknownName


@dataclass(frozen=True, slots=True)
class Option:
    """An option's default, what it means, and the check that says what is expected (None: accepted)."""

    default: Any
    meaning: str
    check: Callable[[Any], str | None]


OMITTED: dict[tuple[str, str], Any] = {
    ("path_tracer", "light_sampler"): "uniform",
    ("path_tracer", "light_candidates"): 1,
    ("path_tracer", "transparent_shadows"): False,
    ("path_tracer", "hide_emitters"): False,
    ("path_tracer", "guiding"): "none",
    ("path_tracer", "bsdf_fraction"): 0.5,
    ("path_tracer", "spatial_threshold"): 4000,
    ("path_tracer", "flux_threshold"): 0.01,
    ("mitsuba", "plugin"): None,
}
"""Options that came after the first published results, with the values at which descriptions leave them out: what those
results describe keeps its identity."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A resolved choice: `name`, every option with its value, and the plugin object where the name is not ours."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    plugin: Any = None

    def describe(self) -> dict[str, Any]:
        """The choice as plain data, the form that configs and results use; `OMITTED` options only where they matter."""
        shown = {key: value for key, value in self.options.items() if OMITTED.get((self.name, key), self) != value}
        return {"name": self.name, **shown}

    @classmethod
    def of(cls, described: Mapping[str, Any]) -> Choice:
        """The choice that `describe` has described."""
        name, options = described["name"], {key: value for key, value in described.items() if key != "name"}
        return cls(name, {**{key: value for (of, key), value in OMITTED.items() if of == name}, **options})

    def __str__(self) -> str:
        """As tables, legends and messages print it: `bvh(leaf=4)`, options by name, those of `OMITTED` where they matter."""
        options = ", ".join(f"{key}={value}" for key, value in sorted(self.describe().items()) if key != "name")
        return f"{self.name}({options})" if options else self.name

    def __lt__(self, other: Choice) -> bool:
        return str(self) < str(other)

    def __hash__(self) -> int:
        return hash((self.name, *sorted(self.options)))  # values may be lists


class OpenOptions(dict[str, Option]):
    """Options of which some are listed, with defaults; all other names take a number, true, false, a line of text or null."""

    def __contains__(self, key: object) -> bool:
        return isinstance(key, str)

    def __missing__(self, key: str) -> Option:
        return Option(None, "passed on as it is", _plain_value)


def _plain_value(value: Any) -> str | None:
    good = value is None or isinstance(value, (bool, int, float)) or (isinstance(value, str) and value.isprintable())
    return None if good else "a number, true, false, a line of text, or null"


def integer(low: int, high: int) -> Callable[[Any], str | None]:
    """A check for whole numbers in [low, high]."""

    def check(value: Any) -> str | None:
        whole = isinstance(value, int) and not isinstance(value, bool)
        return None if whole and low <= value <= high else f"an integer in [{low}, {high}]"

    return check


def number(low: float, high: float) -> Callable[[Any], str | None]:
    """A check for numbers in [low, high]."""

    def check(value: Any) -> str | None:
        real = isinstance(value, (int, float)) and not isinstance(value, bool)
        return None if real and low <= value <= high else f"a number in [{low:g}, {high:g}]"

    return check


def one_of(*names: Any) -> Callable[[Any], str | None]:
    """A check for the values given."""

    def check(value: Any) -> str | None:
        same = any(type(value) is type(name) and value == name for name in names)
        return None if same else "one of " + ", ".join(map(str, names))

    return check


def _point_or_none(value: Any) -> str | None:
    wrong = number(-1e300, 1e300)
    good = value is None or (isinstance(value, (list, tuple)) and len(value) == 3 and not any(map(wrong, value)))
    return None if good else "three numbers, or null for the scene's own bounds"


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


_AMBIENT = Option(0.1, "radiance added to every diffuse hit, times kd", number(0.0, 1e6))

SHADERS: dict[str, dict[str, Option]] = {
    "no_shadows": {"ambient": _AMBIENT},
    "whitted": {"ambient": _AMBIENT, "max_depth": Option(6, "segments of a path, counted from the camera", integer(1, 32))},
    "path_tracer": {
        "max_depth": Option(16, "segments of a path: 1 is emission only, 2 adds direct light", integer(1, 100_000)),
        "rr_depth": Option(5, "segments after which Russian roulette starts", integer(1, 1_000_000)),
        "direct": Option("mis", "how direct light is found", one_of("light", "bsdf", "mis")),
        "light_sampler": Option(
            "uniform",
            "how one light is chosen at a vertex: uniformly, by power, by a light hierarchy, or as learned for cells of space",
            one_of("uniform", "power", "bvh", "spatial"),
        ),
        "light_candidates": Option(
            1,
            "light samples per vertex; one of them, resampled by its unshadowed irradiance, gets a shadow ray",
            integer(1, 32),
        ),
        "transparent_shadows": Option(
            False,
            "whether shadow rays pass null, masks and thin panes, weighted by their transmittance; passing is no segment then",
            one_of(False, True),
        ),
        "hide_emitters": Option(
            False, "whether the camera sees no lights: shapes that emit are absent, environments black", one_of(False, True)
        ),
        "guiding": Option(
            "none", "whether directions are sampled by light that earlier samples have found", one_of("none", "sd_tree")
        ),
        "bsdf_fraction": Option(0.5, "of guided directions, the share that the BSDF samples", number(0.01, 1.0)),
        "spatial_threshold": Option(
            4000,
            "directions found at which a place of the guide is halved; times sqrt(2) at each iteration",
            integer(100, 10**9),
        ),
        "flux_threshold": Option(
            0.01, "share of a place's light at which a solid angle of the guide is divided", number(1e-4, 1.0)
        ),
    },
    "volumetric_path_tracer": {},
    "depth_map": {
        "max_point": Option(
            None, "black: depths from 1.1 times the distance to this point on; null: upper corner of the scene", _point_or_none
        )
    },
    "albedo": {},
}
VOLUMETRIC_OPTIONS = ("max_depth", "rr_depth", "direct", "light_sampler", "light_candidates", "hide_emitters")
"""Of the options of `path_tracer`, those of `volumetric_path_tracer`, whose light samples always pass null lobes."""
SHADERS["volumetric_path_tracer"].update({key: SHADERS["path_tracer"][key] for key in VOLUMETRIC_OPTIONS})

SAMPLERS: dict[str, dict[str, Option]] = {
    "constant": {"value": Option(0.5, "every draw", number(0.0, 1.0 - 2.0**-24))},
    "stratified": {"strata": Option(64, "cells per pixel, a power of four", one_of(4, 16, 64, 256, 1024, 4096))},
    "halton": {"scramble": Option("rotation", "per-pixel randomisation", one_of("rotation", "none"))},
    "random": {},
    "sobol": {"scramble": Option("owen", "per-pixel randomisation", one_of("owen", "none"))},
}

SMOOTH_SAMPLERS = ("random",)
"""Samplers of independent samples, whose error falls smoothly with every sample. That of the others is least after whole
patterns (powers of two, all strata) and larger between them."""

UNBIASED = ("random", "sobol", "halton")
"""Samplers whose images have the right mean with few samples, the best for statistics first."""


def own_samplers(engine: object) -> list[str]:
    """The names of the samplers that only this engine has, by its optional method `samplers`."""
    return list(getattr(engine, "samplers", dict)())


def shaders_and_samplers(engine: object) -> list[dict[str, Any]]:
    """Every shader with every sampler, as keys of `Settings`; those that most engines have come first.

    For single rays neither matters: the first pair that the engine accepts will do.
    """
    shaders = dict.fromkeys(["path_tracer", *SHADERS])
    samplers = dict.fromkeys([*UNBIASED, *SAMPLERS, *own_samplers(engine)])
    return [{"shader": shader, "sampler": sampler} for shader, sampler in product(shaders, samplers)]


def _plugin_choice(kind: str, plugin: Any, options: Mapping[str, Any]) -> Choice:
    """A plugin with its own options, of which some are given. Where the default is a number, the value must be one."""
    defaults = {key: _plain(value) for key, value in (getattr(plugin, "options", None) or {}).items()}
    for key, value in options.items():
        if key not in defaults:
            raise UnknownName(f"option of {kind} {plugin.name!r}", key, defaults)
        lacks = _finite(value) if _finite(defaults[key]) is None else None
        if lacks:
            raise ConfigError(f"{kind} {plugin.name}.{key} = {value!r}: must be {lacks}")
    return Choice(plugin.name, {**defaults, **options}, plugin)


def _finite(value: Any) -> str | None:
    return None if isinstance(value, (int, float)) and math.isfinite(value) else "a finite number"


def resolve(kind: str, given: Any, table: Mapping[str, Mapping[str, Option]]) -> Choice:
    """Turns what a user wrote into a `Choice` with every option present; NumPy numbers become Python's.

    Raises `UnknownName` for names and options not in `table`, `ConfigError` for values out of range. A plugin object
    (not a string or mapping) is taken as it is; its `options` mapping, if it has one, gives names and defaults.
    """
    if isinstance(given, Choice):
        return given if given.plugin is not None else resolve(kind, given.describe(), table)
    if isinstance(given, str):
        given = {"name": given}
    if not isinstance(given, Mapping):
        if not hasattr(given, "name"):
            raise ConfigError(f"{kind} = {given!r}: a name, a mapping with a name, or a plugin object is expected")
        given = {"name": given}
    options = {key: _plain(value) for key, value in given.items()}
    name = options.pop("name", None)
    if isinstance(getattr(name, "name", None), str):
        return _plugin_choice(kind, name, options)
    if not isinstance(name, str):
        raise ConfigError(f"{kind} = {dict(given)!r}: the key 'name' is expected")
    if name not in table:
        raise UnknownName(kind, name, table)
    known = table[name]
    for key, value in options.items():
        if key not in known:
            raise UnknownName(f"option of {kind} {name!r}", key, known)
        expected = known[key].check(value)
        if expected:
            raise ConfigError(f"{kind} {name}.{key} = {value!r}: must be {expected}")
    return Choice(name, {**{key: option.default for key, option in known.items()}, **options})
