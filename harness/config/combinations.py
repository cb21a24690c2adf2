"""From settings, `matrix`, `zip`, `exclude`, `include` and `extend` to the list of combinations.

All conditions of a filter, which `exclude` and `extend.where` have, must match a cell. A condition is a scalar (text may be a
glob), a list of which one must match, `{ge, gt, le, lt: number}`, or, for shaders, samplers and accelerators, a mapping of
conditions on `name` and options.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

from engines.choices import Choice
from engines.registry import split
from engines.schema.keys import Given, Key, Record, Schema
from engines.schema.yaml_file import Located
from harness.config.kinds import RESOLUTION, ListOf, is_number, listing, number
from harness.config.settings import SETTINGS, Budget, Combination
from harness.settings import CHOICES

MAX_COMBINATIONS = 100_000
Axis = list[dict[str, Any]]
"""The values of one axis, or of several that advance together."""


# --- filters --------------------------------------------------------------------------------------------------------


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
    """Conditions by setting, and where they were written."""

    conditions: Mapping[str, Condition]
    where: str

    def matches(self, combination: Combination) -> bool:
        """Whether the combination meets every condition."""
        return all(condition(getattr(combination, key)) for key, condition in self.conditions.items())


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
    return Filter(given.written, given.node.where)


FILTER = Record(
    "Conditions, of which all must match.",
    {name: Key(ConditionKind(name), key.meaning, None) for name, key in SETTINGS.items() if name != "budget"},
    _filter,
)


def condition(key: str, node: Located) -> Condition:
    """The condition at `node` on the setting `key`."""
    value = node.value
    sides = isinstance(value, list) and all(is_number(child.value) for child in value)
    if key == "resolution" and (sides or isinstance(value, str)):
        expected = RESOLUTION.read(node)
        return lambda found: found is not None and tuple(found) == expected
    if isinstance(value, list):
        options = [condition(key, child) for child in listing(node, 1)]
        return lambda found: any(option(found) for option in options)
    if not isinstance(value, dict):
        names = _engine_names if key == "engine" else lambda found: (found,)
        return lambda found: any(_same(name, value) for name in names(found))
    if key in CHOICES and not any(name in COMPARISONS for name in value):
        inner = {name: condition(f"{key}.{name}", child) for name, child in value.items()}
        return lambda found: all(name in _options(found) and test(_options(found)[name]) for name, test in inner.items())
    bounds = _BOUNDS.read(node).written
    if not bounds:
        raise node.refuse("bounds are expected: {ge: 2}")
    if key in ("scene", "engine", "rays", "resolution", "precision", "division", *CHOICES):
        raise node.refuse("bounds are for numbers: a name, a glob or a list is expected")
    return lambda found: is_number(found) and all(COMPARISONS[name](found, x) for name, x in bounds.items())


def _engine_names(found: Any) -> tuple[Any, ...]:
    """An engine's name as it is written, and without the Python that runs it."""
    return (found, split(found)[0]) if isinstance(found, str) else (found,)


def _options(found: Choice) -> dict[str, Any]:
    """The name and the options of a choice."""
    return {"name": found.name, **found.options}


def _same(found: Any, expected: Any) -> bool:
    names = (found.name,) if isinstance(found, Choice) else getattr(found, "names", (found,))
    if isinstance(expected, str):
        return any(isinstance(name, str) and fnmatchcase(name, expected) for name in names)
    return any(name == expected and isinstance(name, bool) == isinstance(expected, bool) for name in names)


# --- the keys -------------------------------------------------------------------------------------------------------


class ZipKind:
    """One mapping of lists, or a list of them."""

    def read(self, node: Located, context: Any = None) -> list[Given]:
        return [_LISTS.read(each, context) for each in ([node] if isinstance(node.value, dict) else listing(node))]

    def schema(self) -> Schema:
        return {"anyOf": [_LISTS.schema(), {"type": "array", "items": _LISTS.schema()}]}


_LISTS = Record("Lists of settings.", {name: Key(ListOf(key.kind, 1), key.meaning, None) for name, key in SETTINGS.items()})
_SETTINGS = Record("Settings.", SETTINGS)
_EXTEND = Record(
    "A change of settings.",
    {
        "where": Key(FILTER, "Filter of the cells that change: all of its conditions must match."),
        "set": Key(_SETTINGS, "Settings that change."),
    },
)
MATRIX = {
    "matrix": Key(_LISTS, "Lists of settings, of which every combination is measured.", None),
    "zip": Key(ZipKind(), "Lists of settings that advance together: one mapping, or a list of them, each an axis.", []),
    "exclude": Key(ListOf(FILTER), "Filters: combinations that match one are left out.", []),
    "include": Key(
        ListOf(_SETTINGS),
        "Whole cells beside the matrix. A setting that one leaves out comes from the first value of each axis.",
        [],
    ),
    "extend": Key(ListOf(_EXTEND), "Settings that change where a filter matches.", []),
}
"""The keys that make combinations of the settings."""


def expand(top: Given) -> tuple[list[Combination], list[str]]:
    """All combinations in the order written, without duplicates, and warnings about filters that match nothing."""
    settings = _changed(Combination(), {key: top[key] for key in SETTINGS})
    axes = _axes(top)
    if not axes and not top.has("engine") and not top.has("include"):
        raise top.node.refuse("a matrix is expected, or at least a scene and an engine")
    combinations = _product(top, settings, axes)
    warnings = [_idle(each) for each in top["exclude"] if not any(map(each.matches, combinations))]
    combinations = [found for found in combinations if not any(each.matches(found) for each in top["exclude"])]
    combinations += _include(top, settings, axes)
    for extension in top["extend"]:
        where, changes = extension["where"], extension["set"].written
        matched = [where.matches(each) for each in combinations]
        warnings += [] if any(matched) else [_idle(where)]
        combinations = [_changed(c, changes) if hit else c for c, hit in zip(combinations, matched, strict=True)]
    return list(reversed(dict.fromkeys(reversed(combinations)))), warnings


def _axes(top: Given) -> list[Axis]:
    lists = top["matrix"].written if top["matrix"] else {}
    found: list[Axis] = [[{key: value} for value in values] for key, values in lists.items()]
    for group in top["zip"]:
        lengths = {len(values) for values in group.written.values()}
        if len(lengths) != 1:
            counted = ", ".join(f"{key} has {len(values)}" for key, values in group.written.items())
            raise group.node.refuse(f"lists that advance together must be equally long: {counted or 'none is given'}")
        found.append([dict(zip(group.written, row, strict=True)) for row in zip(*group.written.values(), strict=True)])
    _one_home(top, found)
    return found


def _one_home(top: Given, axes: list[Axis]) -> None:
    """A setting stands in one place only: top level, matrix or zip. Budgets are the exception: they are merged."""
    seen = {key for key in SETTINGS if key != "budget" and top.has(key)}
    for axis in axes:
        for key in axis[0]:
            if key in seen:
                where = top.at("matrix" if top["matrix"] and top["matrix"].has(key) else "zip")
                raise where.refuse_key(key, "stands elsewhere too: a setting has one home, top level, matrix or zip")
        seen |= set(axis[0])


def _product(top: Given, settings: Combination, axes: list[Axis]) -> list[Combination]:
    missing = [key for key in ("engine", "scene") if not top.has(key) and not any(key in axis[0] for axis in axes)]
    if missing:
        if top.has("include") and not axes:
            return []
        raise top.node.refuse(f"no {' and no '.join(missing)} is given, at the top level or in the matrix")
    count = 1
    for axis in axes:
        count *= len(axis)
    if count > MAX_COMBINATIONS:
        raise top.node.refuse(f"the matrix has {count} combinations: at most {MAX_COMBINATIONS} are allowed")
    return [_changed(settings, *values) for values in itertools.product(*axes)]


def _changed(combination: Combination, *changes: Mapping[str, Any]) -> Combination:
    """A combination after the changes, one after the other; those of budgets are of single keys."""
    for change in changes:
        budget: Budget = replace(combination.budget, **change.get("budget", {}))
        combination = replace(combination, **{**change, "budget": budget})
    return combination


def _include(top: Given, settings: Combination, axes: list[Axis]) -> Iterable[Combination]:
    for cell in top["include"]:
        whole = _changed(settings, *(axis[0] for axis in axes), cell.written)
        for key in ("scene", "engine"):
            if getattr(whole, key) is None:
                raise cell.node.refuse(f"the key {key!r} is expected: an included cell is whole")
        yield whole


def _idle(idle: Filter) -> str:
    return f"{idle.where}: this filter matches nothing"
