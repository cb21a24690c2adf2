"""What the controls of a page offer, from the engines: shaders, samplers, accelerators, and their options."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from engines.choices import SAMPLERS, SHADERS, Option
from engines.interface import Engine, Settings
from engines.registry import engine, engine_names
from engines.scene import scene_from
from engines.tonemap import TONE_MAPPERS
from harness.measure import machine
from harness.processes import one_line
from harness.view.library import Library
from harness.view.requests import MAX_PIXELS, MAX_SIDE, MAX_SPP

PREFERRED = "numba"
COMPILED = ("numba", "embree", "embreex_batch")
"""Engines with kernels that are compiled at their first use, and then read from a cache."""
FIRST_COMPILE_SECONDS = 30
"""About the time that this takes (docs/view.md)."""
PROBE_SCENE = {
    "raybench_scene": 1,
    "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
    "materials": {"white": {"kd": 0.5}},
    "lights": [{"point": {"position": [0, 3, 3], "intensity": 4}}],
    "shapes": [{"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "white"}],
}
"""A scene that every engine renders: a refusal is then due to the sampler or shader in question."""

PROBE_SHADER = {"name": "path_tracer", "max_depth": 16, "rr_depth": 16}
"""Without Russian roulette, which some renderers refuse: it can be switched off in the form."""


def menu(library: Library) -> dict[str, Any]:
    """The menu as plain data. An engine that cannot be loaded is listed with the reason."""
    listed = engines_listed()
    return {
        "engines": listed,
        "shaders": _table(SHADERS),
        "samplers": _table(SAMPLERS),
        "tone_mappers": list(TONE_MAPPERS),
        "scenes": library.names(),
        "cores": len(machine.usable_cores()),
        "preferred": next((e["name"] for e in listed if e["name"] == PREFERRED and not e["problem"]), listed[0]["name"]),
        "first_compile": dict.fromkeys(COMPILED, FIRST_COMPILE_SECONDS),
        "limits": {"side": MAX_SIDE, "pixels": MAX_PIXELS, "spp": MAX_SPP},
    }


@cache
def engines_listed() -> list[dict[str, Any]]:
    """What each engine offers; engines are imported once per process."""
    return [_engine(name) for name in engine_names()]


def _engine(name: str) -> dict[str, Any]:
    try:
        loaded: Engine = engine(name)
        accelerators = _table({"auto": {}, **loaded.accelerators()})
        own = _table(getattr(loaded, "samplers", dict)())
        samplers = [*SAMPLERS, *(sampler["name"] for sampler in own)]
        refused = _refused(loaded, samplers)
    except Exception as error:  # third-party code may raise anything
        return {"name": name, "problem": one_line(error), "accelerators": [], "samplers": [], "refusals": {}}
    problem = _why_nothing(refused["sampler"]) if len(refused["sampler"]) == len(set(samplers)) else None
    return {"name": name, "problem": problem, "accelerators": accelerators, "samplers": own, "refusals": refused}


def _refused(engine: Engine, samplers: Sequence[str]) -> dict[str, dict[str, str]]:
    """Samplers and shaders that the engine refuses: kind -> name -> reason. Shaders are tried with an accepted sampler."""
    scene = scene_from(PROBE_SCENE)
    samplers_refused = {name: engine.why_not(scene, Settings(shader=PROBE_SHADER, sampler=name)) for name in samplers}
    good = next((name for name, reason in samplers_refused.items() if reason is None), samplers[0])
    tried = {**{name: name for name in SHADERS}, "path_tracer": PROBE_SHADER}
    shaders = {name: engine.why_not(scene, Settings(shader=shader, sampler=good)) for name, shader in tried.items()}
    refused = {"sampler": samplers_refused, "shader": shaders}
    return {kind: {name: reason for name, reason in names.items() if reason} for kind, names in refused.items()}


def _why_nothing(reasons: Mapping[str, str]) -> str:
    """Why an engine that refuses every sampler renders nothing: the reason that is not about the sampler, if there is one."""
    return next((reason for name, reason in reasons.items() if f"sampler {name}" not in reason), next(iter(reasons.values())))


def _table(table: Mapping[str, Mapping[str, Option]]) -> list[dict[str, Any]]:
    return [
        {"name": name, "options": [_option(key, option) for key, option in options.items()]} for name, options in table.items()
    ]


def _literal(text: str) -> Any:
    """A number, True or False, or else the text itself."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def _option(key: str, option: Option) -> dict[str, Any]:
    """An option and the values that it accepts, read from the message of its check for a wrong value."""
    accepts = option.check(object()) or ""
    described = {"key": key, "default": option.default, "description": option.meaning, "accepts": accepts, "kind": "json"}
    bounds = re.fullmatch(r"(an integer|a number) in \[(\S+), (\S+)\]", accepts)
    if bounds:
        kind = "integer" if bounds[1] == "an integer" else "number"
        return {**described, "kind": kind, "low": float(bounds[2]), "high": float(bounds[3])}
    if accepts.startswith("one of "):
        values = [_literal(text) for text in accepts.removeprefix("one of ").split(", ")]
        return {**described, "kind": "choice", "values": values}
    return described
