"""From settings, `matrix`, `zip`, `exclude`, `include` and `extend` to the list of combinations."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from engines.schema.keys import Given, Key, Record, Schema
from engines.schema.yaml_file import Located
from harness.config.filters import FILTER, Filter
from harness.config.kinds import ListOf, listing
from harness.config.settings import SETTINGS, Budget, Combination

MAX_COMBINATIONS = 100_000
Axis = list[dict[str, Any]]
"""The values of one axis, or of several that advance together."""


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
    warnings = [line for each in top["exclude"] for line in _idle(each, combinations)]
    combinations = [found for found in combinations if not any(each.matches(found) for each in top["exclude"])]
    combinations += _include(top, settings, axes)
    for extension in top["extend"]:
        where, changes = extension["where"], extension["set"].written
        matched = [where.matches(each) for each in combinations]
        warnings += _idle(where, combinations)
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


def _idle(given: Filter, combinations: Sequence[Combination]) -> list[str]:
    """What of a filter matches nothing: all of it, or members of its lists."""
    if not any(map(given.matches, combinations)):
        return [f"{given.where}: this filter matches nothing"]
    return [f"{where}: {json.dumps(written)} matches nothing" for _, where, written in given.idle_members(combinations)]
