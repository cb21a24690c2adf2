"""Readers of one YAML value each: a checked Python value, or a refusal with file, line, key and what is wanted.

Booleans are neither numbers nor names. Durations and sizes carry their unit: `500ms`, `20s`, `5m`, `1h`; `512 MiB`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from engines.schema.yaml_file import Located

UNITS = {"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12,
         "KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40}  # fmt: skip
"""Bytes by the unit of a size."""
_DURATION = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(ms|s|m|min|h)")
_SIZE = re.compile(rf"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*({'|'.join(UNITS)})")
_SECONDS = {"ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def text(node: Located) -> str:
    """A string that is not empty."""
    if not isinstance(node.value, str) or not node.value.strip():
        raise node.refuse("a name is wanted")
    return node.value


def line_of_text(node: Located) -> str:
    """Any scalar as text: a title may look like a number."""
    if isinstance(node.value, (dict, list, bool)) or node.value is None or not str(node.value).strip():
        raise node.refuse("a line of text is wanted")
    return str(node.value).strip()


def integer(low: int, high: int) -> Callable[[Located], int]:
    """A reader of whole numbers in [low, high]; `64.0` and `1e3` are whole numbers too."""

    def read(node: Located) -> int:
        value = node.value
        if is_number(value) and low <= value <= high and value == int(value):
            return int(value)
        raise node.refuse(f"must be an integer in [{low}, {high}]")

    return read


def number(low: float, high: float, open_low: bool = False) -> Callable[[Located], float]:
    """A reader of numbers in [low, high], both finite, or (low, high] where `open_low`."""

    def read(node: Located) -> float:
        value = node.value
        if is_number(value) and low <= value <= high and not (open_low and value == low):
            return float(value)
        raise node.refuse(f"must be a number in {'(' if open_low else '['}{low:g}, {high:g}]")

    return read


def finite(node: Located) -> None:
    """Refuses infinities and NaN anywhere in a value."""
    value = node.value
    if isinstance(value, float) and not math.isfinite(value):
        raise node.refuse("must be finite")
    for child in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        finite(child)


def one_of(*names: str) -> Callable[[Located], str]:
    def read(node: Located) -> str:
        if isinstance(node.value, str) and node.value in names:
            return node.value
        raise node.refuse("must be one of " + ", ".join(names))

    return read


def duration(node: Located) -> float:
    """Seconds, from text with a unit."""
    found = _DURATION.fullmatch(node.value.strip()) if isinstance(node.value, str) else None
    if found is None:
        raise node.refuse("must be a time with its unit: 500ms, 20s, 5m or 1h")
    seconds = float(found[1]) * _SECONDS[found[2]]
    if not 0.0 < seconds <= 30 * 86400.0:
        raise node.refuse("must be a time above zero and below thirty days")
    return seconds


def size(node: Located) -> int:
    """Bytes, from text with a unit."""
    found = _SIZE.fullmatch(node.value.strip()) if isinstance(node.value, str) else None
    if found is None:
        raise node.refuse("must be a size with its unit: 512MiB, 8 GiB or 8 GB")
    wanted = float(found[1]) * UNITS[found[2]]
    if not 1.0 <= wanted < 2**60:
        raise node.refuse("must be a size from one byte on and below an exbibyte")
    return int(wanted)


def mapping(node: Located, known: Iterable[str] | None = None) -> dict[str, Located]:
    """The children of a mapping; keys outside `known` are refused with the nearest known one."""
    if not isinstance(node.value, dict):
        raise node.refuse("a mapping is wanted")
    names = None if known is None else list(known)
    for key, child in node.value.items():
        if names is not None and key not in names:
            # A key that an override brought is the override's mistake, not the file's.
            raise replace(node, origin=child.origin).unknown_key(key, names)
    return node.value


def listing(node: Located, at_least: int = 0) -> list[Located]:
    """The children of a list."""
    if not isinstance(node.value, list) or len(node.value) < at_least:
        raise node.refuse("a list is wanted" if at_least == 0 else f"a list of at least {at_least} is wanted")
    return node.value


def resolution(node: Located) -> tuple[int, int]:
    """(width, height) in pixels."""
    if not isinstance(node.value, list) or len(node.value) != 2:
        raise node.refuse("[width, height] is wanted")
    pixels = integer(1, 65_536)
    return pixels(node.value[0]), pixels(node.value[1])
