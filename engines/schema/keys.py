"""Descriptions of keys: the one place from which a file's reader, its JSON schema and its reference page come.

    LIGHT = Record("A point that shines.", {
        "position": Key(POINT, "Where it is.", unit="metres"),
        "intensity": Key(color(), "Power in a direction.", 1, unit="W/sr"),
    }, lambda given, context: PointLight(**given.values))
    LIGHT.read(node)       # a PointLight; raises with file, line and path for unknown, missing and wrong keys
    LIGHT.schema()         # a JSON schema with meanings, units and defaults

Whatever has `read(node, context)` and `schema()` may be the kind of a key: a `Kind`, a `Record` and what is made of records.
`context` is the caller's own, and only handed on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from engines.errors import suggestion
from engines.schema import fields
from engines.schema.yaml_file import Located, locate

REQUIRED: Any = ...

Schema = dict[str, Any]


class Readable(Protocol):
    """A kind of value."""

    def read(self, node: Located, context: Any = None) -> Any:
        """The value at `node`, or the error that `Located.refuse` makes."""

    def schema(self) -> Schema:
        """The JSON schema of what `read` accepts; it may accept more."""
        ...


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a mapping. `default` is what a file would say, None where leaving the key out is no value at all.

    `meaning` is a sentence; the schema adds the `unit` and the default to it, unless the default is None or empty.
    """

    kind: Readable
    meaning: str
    default: Any = REQUIRED
    unit: str = ""

    def schema(self) -> Schema:
        """The kind's, with meaning, unit and default."""
        unit = f" Unit: {self.unit}." if self.unit else ""
        silent = self.default is REQUIRED or self.default in (None, "", {}, [])
        default = {} if silent else {"default": _plain(self.default)}
        return {**self.kind.schema(), "description": self.meaning + unit, **default}


def _plain(value: Any) -> Any:
    return [*value] if isinstance(value, tuple) else value


@dataclass(frozen=True, slots=True)
class Given:
    """What a file says in a mapping: `values` by key, with defaults where it says nothing."""

    node: Located
    values: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.values[key]

    @property
    def written(self) -> dict[str, Any]:
        """The values of the keys that the file has, in the order in which they stand there."""
        return {key: self.values[key] for key in self.node.value if key in self.values}

    def has(self, key: str) -> bool:
        """Whether the file has the key."""
        return key in self.node.value

    def at(self, key: str) -> Located:
        """The place of a key that the file has."""
        return self.node.value[key]


@dataclass(frozen=True, slots=True)
class Record:
    """A mapping with these keys and no others; `make(given, context)` turns it into a value or refuses it.

    `either`: groups of keys, of which a file gives exactly one, and that in full.
    """

    meaning: str
    keys: Mapping[str, Key]
    make: Callable[[Given, Any], Any] = lambda given, context: given
    either: Sequence[Sequence[str]] = ()
    _defaults: dict[str, Any] = field(init=False, repr=False, compare=False)
    _required: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        defaults = {
            name: None if key.default is None else key.kind.read(locate(key.default))
            for name, key in self.keys.items()
            if key.default is not REQUIRED
        }
        object.__setattr__(self, "_defaults", defaults)
        object.__setattr__(self, "_required", tuple(name for name in self.keys if name not in defaults))

    def read(self, node: Located, context: Any = None, tag: str = "") -> Any:
        """The value of the mapping at `node`, in which the key `tag` has been read already."""
        known = (tag, *self.keys) if tag else self.keys
        written = fields.mapping(node, known, self._required)
        if self.either:
            self._choose(node)
        values = {
            name: key.kind.read(written[name], context) if name in written else self._defaults[name]
            for name, key in self.keys.items()
        }
        return self.make(Given(node, values), context)

    def _choose(self, node: Located) -> None:
        ways = [way for way in self.either if any(name in node.value for name in way)]
        expected = [" and ".join(way) for way in self.either]
        expected = f"{', '.join(expected[:-1])}, or {expected[-1]}"
        if not ways:
            raise node.refuse(f"needs {expected}")
        for name in [name for way in ways[1:] for name in way if name in node.value]:
            raise node.refuse_key(name, f"either {expected}")
        for name in ways[0]:
            if name not in node.value:
                raise node.refuse_key(name, "is missing")

    def schema(self, tag: Mapping[str, Schema] | None = None) -> Schema:
        """A closed object of these keys and of `tag`, a property of the caller's."""
        properties = {**(tag or {}), **{name: key.schema() for name, key in self.keys.items()}}
        required = [*(tag or {}), *self._required]
        found = {"type": "object", "additionalProperties": False, "properties": properties, "description": self.meaning}
        if required:
            found["required"] = required
        if self.either:
            found["oneOf"] = [{"required": [*way]} for way in self.either]
        return found


@dataclass(frozen=True, slots=True)
class Tagged:
    """A mapping whose key `tag` names one of the `records`: `{type: perspective, eye: ...}`.

    `other(node, named, context)` reads mappings whose tag, at `named`, is none of them; `other_schema` is theirs.
    """

    what: str
    tag: str
    records: Mapping[str, Record]
    other: Callable[[Located, Located, Any], Any] | None = None
    other_schema: Schema | None = None

    def read(self, node: Located, context: Any = None) -> Any:
        """The value of the record that the tag names."""
        if not isinstance(node.value, dict):
            raise node.refuse(f"must be a mapping with a {self.tag} and the keys of that {self.what}")
        named = node.value.get(self.tag)
        if named is None:
            raise node.refuse_key(self.tag, f"is missing: known: {', '.join(sorted(self.records))}")
        if isinstance(named.value, str) and named.value in self.records:
            return self.records[named.value].read(node, context, self.tag)
        if self.other is not None:
            return self.other(node, named, context)
        raise named.refuse(f"unknown {self.what}: {suggestion(str(named.value), self.records)}")

    def schema(self) -> Schema:
        """Any of the records', with their tags."""
        found = [
            record.schema({self.tag: {"const": name, "description": f"The kind of {self.what}."}})
            for name, record in self.records.items()
        ]
        return {"anyOf": found if self.other_schema is None else [*found, self.other_schema]}


@dataclass(frozen=True, slots=True)
class Variants:
    """A mapping with one key of `records`, its kind, and those of `beside`: `{sphere: {...}, material: red}`."""

    what: str
    records: Mapping[str, Readable]
    beside: Mapping[str, Key] = field(default_factory=dict)

    def choose(self, node: Located) -> str:
        """The kind of the mapping at `node`."""
        kinds = ", ".join(self.records)
        if not isinstance(node.value, dict):
            beside = "".join(f" and {key}" for key in self.beside)
            raise node.refuse(f"must be a mapping with one key, the kind of {self.what} ({kinds}){beside}")
        names = [key for key in node.value if key not in self.beside]
        for key in names:
            if key not in self.records:
                raise node.refuse_key(key, f"unknown {self.what}: {suggestion(key, [*self.records, *self.beside])}")
        if len(names) != 1:
            raise node.refuse(f"must have one kind of {self.what}: {kinds}")
        return names[0]

    def read(self, node: Located, context: Any = None) -> Any:
        """The value of the record; the keys of `beside` are the caller's to read."""
        kind = self.choose(node)
        return self.records[kind].read(node.value[kind], context)

    def schema(self) -> Schema:
        """Any of the kinds, each an object with one key and those of `beside`."""
        beside = {name: key.schema() for name, key in self.beside.items()}
        return {"anyOf": [_closed({kind: record.schema(), **beside}, kind) for kind, record in self.records.items()]}


def _closed(properties: Schema, required: str) -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": properties, "required": [required]}


@dataclass(frozen=True, slots=True)
class _Each:
    """Values of one kind in a list, or by names of the user's own; null counts as none of them."""

    kind: Readable
    what: str
    named: bool

    def read(self, node: Located, context: Any = None) -> Any:
        if not self.named:
            return [self.kind.read(child, context) for child in fields.items(node, self.what)]
        if node.value is not None and not isinstance(node.value, dict):
            raise node.refuse(f"must be a mapping from names to {self.what}")
        return {name: self.kind.read(child, context) for name, child in (node.value or {}).items()}

    def schema(self) -> Schema:
        if self.named:
            return {"type": ["object", "null"], "additionalProperties": self.kind.schema()}
        return {"type": ["array", "null"], "items": self.kind.schema()}


def list_of(kind: Readable, what: str) -> Readable:
    """Reads a list; messages call its items `what`."""
    return _Each(kind, what, named=False)


def by_name(kind: Readable, what: str) -> Readable:
    """Reads a mapping from names of the user's own; the last step of a value's `path` is its name."""
    return _Each(kind, what, named=True)
