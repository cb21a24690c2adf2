"""Filters: conditions on settings, which `exclude`, `extend.where`, `baseline` and `pairs` have.

All conditions of a filter must match. A condition is a scalar (text may be a glob), a list of which one must match,
`{ge, gt, le, lt: number}`, or, for shaders, samplers and accelerators, a mapping of conditions on `name` and options.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from engines.choices import Choice
from engines.registry import split
from engines.schema.keys import Given, Key, Record, Schema
from engines.schema.yaml_file import Located
from harness.config.kinds import NAME, RESOLUTION, is_number, listing, number
from harness.config.settings import SETTINGS
from harness.settings import CHOICES

COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "ge": operator.ge,
    "gt": operator.gt,
    "le": operator.le,
    "lt": operator.lt,
}
_BOUND = number(-1e300, 1e300)
_BOUNDS = Record(
    "Bounds of a number.",
    {
        "ge": Key(_BOUND, "At least this.", None),
        "gt": Key(_BOUND, "More than this.", None),
        "le": Key(_BOUND, "At most this.", None),
        "lt": Key(_BOUND, "Less than this.", None),
    },
)
Condition = Callable[[Any], bool]


@dataclass(frozen=True, slots=True)
class Filter:
    """Conditions by setting; `written` is what the file says, `where` its place. `members` are the conditions of lists, each as
    (setting, its place, what the file says, condition)."""

    conditions: Mapping[str, Condition] = field(compare=False)
    written: Mapping[str, Any]
    where: str = field(compare=False)
    members: tuple[tuple[str, str, Any, Condition], ...] = field(compare=False)

    def matches(self, one: Any) -> bool:
        """Whether a combination, or what else has settings as attributes, meets every condition. What it lacks meets none: rays
        have no sampler."""
        return all(hasattr(one, key) and condition(getattr(one, key)) for key, condition in self.conditions.items())

    def idle_members(self, ones: Sequence[Any]) -> list[tuple[str, str, Any]]:
        """The members of lists that match none of these: (setting, its place, what the file says)."""
        return [
            (key, where, written)
            for key, where, written, matches in self.members
            if not any(hasattr(one, key) and matches(getattr(one, key)) for one in ones)
        ]

    def __str__(self) -> str:
        """`{engine: "numba", threads: 2}`"""
        return "{" + ", ".join(f"{key}: {json.dumps(value)}" for key, value in self.written.items()) + "}"


@dataclass(frozen=True, slots=True)
class ConditionKind:
    """A condition on one setting."""

    key: str

    def read(self, node: Located, context: Any = None) -> Condition:
        return condition(self.key, node)

    def schema(self) -> Schema:
        if self.key != "threads":
            return {}
        return {"anyOf": [{"not": {"type": "object"}}, _BOUNDS.schema()]}


def _filter(given: Given, context: Any) -> Filter:
    """An empty one is refused, for it would match everything."""
    if not given.written:
        raise given.node.refuse("at least one condition is expected")
    members = tuple((key, *member) for key, child in given.node.value.items() for member in _members(key, child))
    return Filter(given.written, given.node.plain(), given.node.where, members)


def _members(key: str, node: Located) -> Iterator[tuple[str, Any, Condition]]:
    """The members of the lists in a condition."""
    if is_list(key, node):
        yield from ((each.where, each.plain(), condition(key, each)) for each in node.value)
    elif key in CHOICES and isinstance(node.value, dict):
        for name, child in node.value.items():
            for where, written, matches in _members(f"{key}.{name}", child):
                yield where, written, _of_option(name, matches)


def _of_option(name: str, matches: Condition) -> Condition:
    return lambda found: name in _options(found) and matches(_options(found)[name])


FILTER = Record(
    "Conditions, of which all must match.",
    {name: Key(ConditionKind(name), key.meaning, None) for name, key in SETTINGS.items() if name != "budget"},
    _filter,
)


class ContestantsKind:
    """Contestants by a filter of their settings. A bare name is that of an engine."""

    def read(self, node: Located, context: Any = None) -> Filter:
        if isinstance(node.value, str):
            node = replace(node, value={"engine": replace(node, value=NAME.read(node))})
        if node.value == {}:
            raise node.refuse("at least one setting is expected")
        return FILTER.read(node, context)

    def write(self, value: Filter) -> dict[str, Any]:
        return {**value.written}

    def schema(self) -> Schema:
        return {"anyOf": [NAME.schema(), FILTER.schema()]}


CONTESTANTS = ContestantsKind()


def is_list(key: str, node: Located) -> bool:
    """Whether the condition at `node` is a list of conditions: two numbers are one resolution."""
    value = node.value
    return isinstance(value, list) and not (key == "resolution" and all(is_number(child.value) for child in value))


def condition(key: str, node: Located) -> Condition:
    """The condition at `node` on the setting `key`."""
    value = node.value
    if key == "resolution" and isinstance(value, (list, str)) and not is_list(key, node):
        expected = RESOLUTION.read(node)
        return lambda found: found is not None and tuple(found) == expected
    if isinstance(value, list):
        options = [condition(key, child) for child in listing(node, 1)]
        return lambda found: any(option(found) for option in options)
    if not isinstance(value, dict):
        names = _engine_names if key == "engine" else lambda found: (found,)
        return lambda found: any(_same(name, value) for name in names(found))
    if key in CHOICES and not any(name in COMPARISONS for name in value):
        inner = [_of_option(name, condition(f"{key}.{name}", child)) for name, child in value.items()]
        return lambda found: all(test(found) for test in inner)
    bounds = _BOUNDS.read(node).written
    if not bounds:
        raise node.refuse("bounds are expected: {ge: 2}")
    if key in ("scene", "engine", "rays", "resolution", "precision", "division", *CHOICES):
        raise node.refuse("bounds are for numbers: a name, a glob or a list is expected")
    return lambda found: is_number(found) and all(COMPARISONS[name](found, x) for name, x in bounds.items())


def _engine_names(found: Any) -> tuple[Any, ...]:
    """An engine's name as it is written, and without the Python that runs it."""
    return (found, split(found)[0]) if isinstance(found, str) else (found,)


def _options(found: Choice | None) -> dict[str, Any]:
    """The name and the options of a choice; none where the shader is left to the scene."""
    return {} if found is None else {"name": found.name, **found.options}


def _same(found: Any, expected: Any) -> bool:
    names = (found.name,) if isinstance(found, Choice) else getattr(found, "names", (found,))
    if isinstance(expected, str):
        return any(isinstance(name, str) and fnmatchcase(name, expected) for name in names)
    return any(name == expected and isinstance(name, bool) == isinstance(expected, bool) for name in names)
