"""What the page's controls offer, as the engines list it: engines, shaders, samplers, accelerators, and their options."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from engines.choices import SAMPLERS, SHADERS, Option
from engines.errors import RaybenchError
from engines.interface import Engine
from engines.registry import engine, engine_names
from engines.tonemap import TONE_MAPPERS
from harness import machine
from harness.view.library import Library
from harness.view.requests import LARGEST_SIDE, MOST_PIXELS, MOST_SPP

PREFERRED = "embree"


def menu(library: Library) -> dict[str, Any]:
    """All of it, as plain data. An engine that cannot be loaded is listed with the reason."""
    listed = engines_listed()
    return {
        "engines": listed, "shaders": _table(SHADERS), "samplers": _table(SAMPLERS), "tone_mappers": list(TONE_MAPPERS),
        "scenes": library.names(), "cores": len(machine.usable_cores()),
        "preferred": next((e["name"] for e in listed if e["name"] == PREFERRED and not e["lacks"]), listed[0]["name"]),
        "limits": {"side": LARGEST_SIDE, "pixels": MOST_PIXELS, "spp": MOST_SPP},
    }  # fmt: skip


@cache
def engines_listed() -> list[dict[str, Any]]:
    """The engines, each imported and asked; once in a process."""
    return [_engine(name) for name in engine_names()]


def _engine(name: str) -> dict[str, Any]:
    try:
        found: Engine = engine(name)
        accelerators = _table({"auto": {}, **found.accelerators()})
        own = _table(getattr(found, "samplers", dict)())
    except RaybenchError as error:
        return {"name": name, "lacks": str(error), "accelerators": [], "samplers": []}
    except Exception as error:  # what others wrote may fail in any way
        return {"name": name, "lacks": f"{type(error).__name__}: {error}", "accelerators": [], "samplers": []}
    return {"name": name, "lacks": None, "accelerators": accelerators, "samplers": own}


def _table(table: Mapping[str, Mapping[str, Option]]) -> list[dict[str, Any]]:
    return [{"name": name, "options": [_option(key, option) for key, option in options.items()]}
            for name, options in table.items()]  # fmt: skip


def _literal(word: str) -> Any:
    """A number, True or False, or else the word itself."""
    try:
        return ast.literal_eval(word)
    except (ValueError, SyntaxError):
        return word


def _option(key: str, option: Option) -> dict[str, Any]:
    """An option with the values that it takes, read from what its check says to a value that is surely wrong."""
    wanted = option.check(object()) or ""
    told = {"key": key, "default": option.default, "meaning": option.meaning, "wanted": wanted, "kind": "json"}
    bounds = re.fullmatch(r"(an integer|a number) in \[(\S+), (\S+)\]", wanted)
    if bounds:
        kind = "integer" if bounds[1] == "an integer" else "number"
        return {**told, "kind": kind, "low": float(bounds[2]), "high": float(bounds[3])}
    if wanted.startswith("one of "):
        return {**told, "kind": "one", "values": [_literal(word) for word in wanted.removeprefix("one of ").split(", ")]}
    return told
