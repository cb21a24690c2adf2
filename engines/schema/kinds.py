"""Kinds of values: each reads a `Located` into a plain value and has a JSON schema."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from engines.schema import fields
from engines.schema.yaml_file import Located


@dataclass(frozen=True, slots=True)
class Kind:
    """`reader` turns a Located into a value, or raises what `Located.refuse` makes; `json` is its JSON schema; `writer` turns
    the value back into what a file says."""

    reader: Callable[[Located], Any]
    json: Mapping[str, Any]
    writer: Callable[[Any], Any] = lambda value: value

    def read(self, node: Located, context: Any = None) -> Any:
        """The value at `node`."""
        return self.reader(node)

    def write(self, value: Any) -> Any:
        """What a file says where `read` returns `value`."""
        return self.writer(value)

    def schema(self) -> dict[str, Any]:
        """Its JSON schema."""
        return dict(self.json)


@dataclass(frozen=True, slots=True)
class ContextKind:
    """A kind of what is understood with the caller's context, such as the names that a file has given before.

    `reader(node, context)` turns a Located into a value, or raises what `Located.refuse` makes; `json` is its JSON schema.
    """

    reader: Callable[[Located, Any], Any]
    json: Mapping[str, Any]

    def read(self, node: Located, context: Any = None) -> Any:
        """The value at `node`."""
        return self.reader(node, context)

    def schema(self) -> dict[str, Any]:
        """Its JSON schema."""
        return dict(self.json)


def one_of(known: Collection[str], what: str) -> Kind:
    """One of the names of a `what`."""
    return Kind(lambda node: fields.one_of(node, known, what), {"enum": [*known]})


def integer(low: int, high: int) -> Kind:
    """A whole number in [low, high]."""
    bounds = {"minimum": low, "maximum": high} if low < high else {"const": low}
    return Kind(lambda node: fields.integer(node, low, high), {"type": "integer", **bounds})


def within(low: float, high: float) -> Kind:
    """A number in [low, high]."""
    return Kind(lambda node: fields.within(node, low, high), {"type": "number", "minimum": low, **_at_most(high)})


def _at_most(high: float) -> dict[str, float]:
    return {} if math.isinf(high) else {"maximum": high}


def color(high: float = math.inf) -> Kind:
    """A number for grey or [r, g, b], each in [0, high]."""
    channel = {"type": "number", "minimum": 0, **_at_most(high)}
    return Kind(lambda node: fields.color(node, high), {"anyOf": [channel, array_of(channel, 3)]})


def array_of(item: Mapping[str, Any], least: int, most: int | None = None) -> dict[str, Any]:
    """The JSON schema of a list of `least` items, or of `least` to `most`."""
    return {"type": "array", "items": item, "minItems": least, "maxItems": least if most is None else most}


TEXT = Kind(fields.text, {"type": "string"})
BOOLEAN = Kind(fields.boolean, {"type": "boolean"})
NUMBER = Kind(fields.number, {"type": "number"})
POSITIVE = Kind(fields.positive, {"type": "number", "exclusiveMinimum": 0})
ANGLE = Kind(fields.angle, {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180})
POINT = Kind(fields.triple, array_of(NUMBER.json, 3))
DIRECTION = Kind(fields.direction, POINT.json)
ROWS = Kind(lambda node: node, {"type": "array", "items": POINT.json, "minItems": 1})
"""Lists of three numbers, or an array (n, 3), as they stand: `fields.rows` reads them, where their limits are known."""
