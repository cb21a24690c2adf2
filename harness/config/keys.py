"""Keys of config files: a frozen dataclass holds a mapping of a file, and each of its fields says one key (`key`).

@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    \"\"\"When a cell ends.\"\"\"
    max_spp: int = key(integer(1, 2**31), "Samples per pixel of the last checkpoint.", 1024)
    timeout_seconds: float = key(DURATION, "Wall time after which a cell is killed.", "300s", name="timeout")

BUDGET = Section(Budget)       # reads mappings into a Budget, writes a Budget as a mapping, has a JSON schema
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, Generic, TypeVar

from engines.schema.keys import REQUIRED, Given, Key, Record, Schema
from engines.schema.yaml_file import Located, locate
from harness.config.kinds import Value, mapping

T = TypeVar("T")


def key(kind: Value, meaning: str = "", default: Any = REQUIRED, unit: str = "", name: str = "") -> Any:
    """The field of a dataclass that holds a key of a file, of the field's own name unless `name` gives another.

    `default` is what a file would say, None where leaving the key out is no value at all. Without a `meaning` it is that of the
    kind, which must be a `Section`.
    """
    described = {"key": Key(kind, meaning or kind.meaning, default, unit), "name": name}  # pyright: ignore
    if default is REQUIRED:
        return field(metadata=described)
    return field(default=None if default is None else kind.read(locate(default)), metadata=described)


def keys_of(made: Any) -> dict[str, Key]:
    """The keys that the fields of a dataclass describe, by their names in a file."""
    return {name: each.metadata["key"] for name, each in _fields(made).items()}


def by_field(made: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by the names of the fields, from values by the names of keys in a file; other values are left out."""
    return {each.name: values[name] for name, each in _fields(made).items() if name in values}


def written(value: Any) -> dict[str, Any]:
    """A dataclass of keys as a file says it, every default filled in; None where that is the default is left out."""
    found = {}
    for name, each in _fields(value).items():
        described, own = each.metadata["key"], getattr(value, each.name)
        if own is not None or described.default is not None:
            found[name] = described.kind.write(own)
    return found


def _fields(made: Any) -> dict[str, Field[Any]]:
    """The fields that hold keys, by the names of these in a file."""
    return {each.metadata["name"] or each.name: each for each in fields(made) if "key" in each.metadata}


class Section(Generic[T]):
    """A mapping that is read into a dataclass of keys. `check(value, given, context)` returns the value, or another, or refuses
    it. The first paragraph of the dataclass's docstring is the meaning."""

    def __init__(self, made: type[T], check: Callable[[T, Given, Any], T] = lambda value, given, context: value) -> None:
        self.meaning = " ".join((inspect.getdoc(made) or "").partition("\n\n")[0].split())
        self._made, self._check = made, check
        self._record = Record(self.meaning, keys_of(made), self._make)

    def _make(self, given: Given, context: Any) -> T:
        return self._check(self._made(**by_field(self._made, given.values)), given, context)

    def read(self, node: Located, context: Any = None) -> T:
        """The value of the mapping at `node`; raises with file, line and path for unknown, missing and wrong keys."""
        return self._record.read(node, context)

    def changes(self, node: Located, context: Any = None) -> dict[str, Any]:
        """The values of the keys that the mapping has, by fields."""
        mapping(node)
        return by_field(self._made, replace(self._record, make=lambda given, context: given.written).read(node, context))

    def write(self, value: T) -> dict[str, Any]:
        """What a file says where `read` returns `value`, every default filled in."""
        return written(value)

    def schema(self) -> Schema:
        """The JSON schema of the mapping."""
        return self._record.schema()


@dataclass(frozen=True, slots=True)
class Changes:
    """Some keys of a section: the values that a file says, by fields, for `dataclasses.replace`."""

    section: Section[Any]

    def read(self, node: Located, context: Any = None) -> dict[str, Any]:
        return self.section.changes(node, context)

    def schema(self) -> Schema:
        return self.section.schema()
