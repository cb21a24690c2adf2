"""Kinds of values in experiment files, beside those of `engines.schema.kinds`, and readers that they share.

Booleans are neither numbers nor names. Durations and sizes carry their unit: `500ms`, `20s`, `5m`, `1h`; `512 MiB`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from engines.schema.keys import Readable, Schema
from engines.schema.kinds import Kind
from engines.schema.yaml_file import Located

RECORDED: Any = object()
"""The context of what was read before, perhaps on another machine, and is not going to be run: files, engines and packages that
it names are not looked up. Else the context is the folder of the file that is read, or None."""
UNITS = {"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40}
"""Bytes by the unit of a size."""
_SECONDS = {"ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_NUMBER = r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_DURATION = rf"{_NUMBER}\s*({'|'.join(_SECONDS)})"
_SIZE = rf"{_NUMBER}\s*({'|'.join(UNITS)})"


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def mapping(node: Located) -> dict[str, Located]:
    """The children of a mapping."""
    if not isinstance(node.value, dict):
        raise node.refuse("a mapping is expected")
    return node.value


def listing(node: Located, at_least: int = 0) -> list[Located]:
    """The children of a list."""
    if not isinstance(node.value, list) or len(node.value) < at_least:
        raise node.refuse("a list is expected" if at_least == 0 else f"a list of at least {at_least} is expected")
    return node.value


def finite(node: Located) -> None:
    """Refuses infinities and NaN anywhere in a value."""
    value = node.value
    if isinstance(value, float) and not math.isfinite(value):
        raise node.refuse("must be finite")
    for child in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        finite(child)


# --- kinds ----------------------------------------------------------------------------------------------------------


class Value(Readable, Protocol):
    """A kind of value that is written as it is read."""

    def write(self, value: Any) -> Any:
        """What a file says where `read` returns `value`."""


def integer(low: int, high: int) -> Kind:
    """A whole number in [low, high]; `64.0` and `1e3` are whole numbers too."""

    def read(node: Located) -> int:
        value = node.value
        if is_number(value) and low <= value <= high and value == int(value):
            return int(value)
        raise node.refuse(f"must be an integer in [{low}, {high}]")

    return Kind(read, {"type": "integer", "minimum": low, "maximum": high})


def number(low: float, high: float, open_low: bool = False) -> Kind:
    """A number in [low, high], both finite, or (low, high] where `open_low`."""

    def read(node: Located) -> float:
        value = node.value
        if is_number(value) and low <= value <= high and not (open_low and value == low):
            return float(value)
        raise node.refuse(f"must be a number in {'(' if open_low else '['}{low:g}, {high:g}]")

    return Kind(read, {"type": "number", "exclusiveMinimum" if open_low else "minimum": low, "maximum": high})


def version(number: int) -> Kind:
    """The version of the format that is read here."""

    def read(node: Located) -> int:
        if node.value != number or node.value is True:
            raise node.refuse(f"must be {number}")
        return number

    return Kind(read, {"const": number})


def one_of(*names: str) -> Kind:
    """One of these names."""

    def read(node: Located) -> str:
        if isinstance(node.value, str) and node.value in names:
            return node.value
        raise node.refuse("must be one of " + ", ".join(names))

    return Kind(read, {"enum": [*names]})


@dataclass(frozen=True, slots=True)
class OrNull:
    """A value of `kind`, or null."""

    kind: Value

    def read(self, node: Located, context: Any = None) -> Any:
        return None if node.value is None else self.kind.read(node, context)

    def write(self, value: Any) -> Any:
        return None if value is None else self.kind.write(value)

    def schema(self) -> Schema:
        return {"anyOf": [self.kind.schema(), {"const": None}]}


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list of values of one kind, read as a tuple."""

    kind: Readable
    at_least: int = 0

    def read(self, node: Located, context: Any = None) -> tuple[Any, ...]:
        return tuple(self.kind.read(child, context) for child in listing(node, self.at_least))

    def write(self, value: Any) -> list[Any]:
        kind: Any = self.kind
        return [kind.write(each) for each in value]

    def schema(self) -> Schema:
        return {"type": "array", "items": self.kind.schema(), **({"minItems": self.at_least} if self.at_least else {})}


def _text(node: Located) -> str:
    if not isinstance(node.value, str) or not node.value.strip():
        raise node.refuse("a name is expected")
    return node.value


def _line(node: Located) -> str:
    if isinstance(node.value, (dict, list, bool)) or node.value is None or not str(node.value).strip():
        raise node.refuse("a line of text is expected")
    return str(node.value).strip()


def _with_unit(node: Located, pattern: str, units: dict[str, Any], wanted: str) -> float:
    found = re.fullmatch(pattern, node.value.strip()) if isinstance(node.value, str) else None
    if found is None:
        raise node.refuse(f"must be {wanted}")
    return float(found[1]) * units[found[2]]


def _duration(node: Located) -> float:
    seconds = _with_unit(node, _DURATION, _SECONDS, "a time with its unit: 500ms, 20s, 5m or 1h")
    if not 0.0 < seconds <= 30 * 86400.0:
        raise node.refuse("must be a time above zero and below thirty days")
    return seconds


def _size(node: Located) -> int:
    found = _with_unit(node, _SIZE, UNITS, "a size with its unit: 512MiB, 8 GiB or 8 GB")
    if not 1.0 <= found < 2**60:
        raise node.refuse("must be a size from one byte on and below an exbibyte")
    return int(found)


def _seconds_text(seconds: float) -> str:
    return f"{np.format_float_positional(seconds, trim='-')}s"


def _size_text(size: int) -> str:
    unit = max((each for each in UNITS if size % UNITS[each] == 0), key=UNITS.__getitem__)
    return f"{size // UNITS[unit]}{unit}"


_PIXELS = integer(1, 65_536)


PIXEL_COUNTS = r"([0-9]{1,9})[xX]([0-9]{1,9})"
"""Width and height as text, on the command line and in files."""


def width_and_height(text: str) -> tuple[int, int] | None:
    """Of `256x192`; None for other text."""
    found = re.fullmatch(PIXEL_COUNTS, text.strip())
    return (int(found[1]), int(found[2])) if found else None


def _resolution(node: Located) -> tuple[int, int]:
    if isinstance(node.value, list) and len(node.value) == 2:
        return _PIXELS.read(node.value[0]), _PIXELS.read(node.value[1])
    sides = width_and_height(node.value) if isinstance(node.value, str) else None
    if sides is None:
        raise node.refuse("width and height are expected, as 256x192 or [256, 192]")
    return _PIXELS.read(replace(node, value=sides[0])), _PIXELS.read(replace(node, value=sides[1]))


NAME = Kind(_text, {"type": "string"})
"""A string that is not empty."""
LINE = Kind(_line, {"type": ["string", "number"]})
"""Any scalar as text: a title may look like a number."""
DURATION = Kind(_duration, {"type": "string", "pattern": rf"^\s*{_DURATION}\s*$"}, _seconds_text)
"""Seconds, from text with a unit."""
SIZE = Kind(_size, {"type": "string", "pattern": rf"^\s*{_SIZE}\s*$"}, _size_text)
"""Bytes, from text with a unit."""
RESOLUTION = Kind(
    _resolution,
    {
        "anyOf": [
            {"type": "array", "items": _PIXELS.json, "minItems": 2, "maxItems": 2},
            {"type": "string", "pattern": f"^{PIXEL_COUNTS}$"},
        ]
    },
    list,
)
"""(width, height) in pixels."""
SEED = integer(0, 2**63 - 1)
