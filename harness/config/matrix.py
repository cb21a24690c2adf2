"""From settings, `matrix`, `zip`, `exclude`, `include` and `extend` to the list of combinations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from engines.scene.yaml_file import Located
from harness.config import paths, validators
from harness.config.filters import Filter, read_filter
from harness.config.settings import DEFAULTS, SETTING_READERS, Budget
from harness.hashing import canonical_json

SETTINGS = tuple(SETTING_READERS)
MATCHABLE = tuple(key for key in SETTINGS if key != "budget")
MAX_COMBINATIONS = 100_000
Axis = list[dict[str, Any]]
"""The values of one axis, or of several that advance together."""


def read(key: str, node: Located, folder: Path) -> Any:
    """One setting's value."""
    return SETTING_READERS[key](node, folder)


def plain(combination: Mapping[str, Any]) -> dict[str, Any]:
    """A combination as data for JSON."""
    found = {
        key: asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
        for key, value in combination.items()
    }
    scene = combination["scene"]
    return {**found, "scene": {"name": scene.name, "path": paths.shown(Path(scene.path))}}


def expand(root: Located, folder: Path, budget: Budget) -> tuple[list[dict[str, Any]], list[str]]:
    """All combinations in the order written, without duplicates, and warnings about filters that match nothing."""
    top = root.value
    fixed = {key: read(key, top[key], folder) for key in SETTINGS if key in top and key != "budget"}
    found = _axes(top, folder)
    _one_home(top, found)
    if not found and "engine" not in fixed and not top.get("include"):
        raise root.refuse("a matrix is wanted, or at least a scene and an engine")
    combinations = _product(root, fixed, found, budget)
    warnings: list[str] = []
    combinations = _exclude(top, combinations, warnings)
    combinations += _include(root, folder, fixed, found, budget)
    _extend(top, folder, combinations, warnings)
    unique = {canonical_json(plain(combination)): combination for combination in reversed(combinations)}
    return list(reversed(unique.values())), warnings


def _axes(top: Mapping[str, Located], folder: Path) -> list[Axis]:
    found: list[Axis] = []
    if "matrix" in top:
        for key, node in validators.mapping(top["matrix"], SETTINGS).items():
            found.append([{key: read(key, child, folder)} for child in validators.listing(node, 1)])
    groups = top.get("zip")
    listed = [] if groups is None else [groups] if isinstance(groups.value, dict) else validators.listing(groups)
    for group in listed:
        lists = {key: validators.listing(node, 1) for key, node in validators.mapping(group, SETTINGS).items()}
        lengths = {len(children) for children in lists.values()}
        if len(lengths) != 1:
            counted = ", ".join(f"{key} has {len(children)}" for key, children in lists.items())
            raise group.refuse(f"lists that advance together must be equally long: {counted or 'none is given'}")
        found.append([
            {key: read(key, children[index], folder) for key, children in lists.items()}
            for index in range(lengths.pop())
        ])  # fmt: skip
    return found


def _one_home(top: Mapping[str, Located], found: list[Axis]) -> None:
    """A setting stands in one place only: top level, matrix or zip. Budgets are the exception: they are merged."""
    seen = {key for key in top if key in MATCHABLE}
    for axis in found:
        for key in axis[0]:
            if key in seen:
                where = top["matrix"] if "matrix" in top and key in top["matrix"].value else top["zip"]
                raise where.refuse_key(key, "stands elsewhere too: a setting has one home, top level, matrix or zip")
        seen |= set(axis[0])


def _product(root: Located, fixed: Mapping[str, Any], found: list[Axis], budget: Budget) -> list[dict[str, Any]]:
    given = set(fixed).union(*(axis[0] for axis in found)) if found else set(fixed)
    if not {"scene", "engine"} <= given:
        if root.value.get("include") is not None and not found:
            return []
        missing = sorted({"scene", "engine"} - given)
        raise root.refuse(f"no {' and no '.join(missing)} is given, at the top level or in the matrix")
    count = 1
    for axis in found:
        count *= len(axis)
    if count > MAX_COMBINATIONS:
        raise root.refuse(f"the matrix has {count} combinations: at most {MAX_COMBINATIONS} are allowed")
    return [_combined(fixed, values, budget) for values in itertools.product(*found)]


def _combined(fixed: Mapping[str, Any], values: tuple[Mapping[str, Any], ...], budget: Budget) -> dict[str, Any]:
    merged = {**DEFAULTS, **fixed}
    changes: dict[str, Any] = {}
    for value in values:
        merged.update(value)
        changes |= value.get("budget", {})
    merged["budget"] = budget.merged(changes)
    return {key: merged[key] for key in SETTINGS}


def _exclude(
    top: Mapping[str, Located], combinations: list[dict[str, Any]], warnings: list[str]
) -> list[dict[str, Any]]:
    filters = [read_filter(node, MATCHABLE) for node in validators.listing(top["exclude"])] if "exclude" in top else []
    warnings += [_idle(each) for each in filters if not any(map(each.matches, combinations))]
    return [combination for combination in combinations if not any(each.matches(combination) for each in filters)]


def _include(
    root: Located, folder: Path, fixed: Mapping[str, Any], found: list[Axis], budget: Budget
) -> list[dict[str, Any]]:
    if "include" not in root.value:
        return []
    firsts = tuple(axis[0] for axis in found)
    included = []
    for node in validators.listing(root.value["include"]):
        children = validators.mapping(node, SETTINGS)
        values = {key: read(key, child, folder) for key, child in children.items()}
        whole = {**fixed, **{key: value for first in firsts for key, value in first.items()}, **values}
        for key in ("scene", "engine"):
            if key not in whole:
                raise node.refuse(f"the key {key!r} is wanted: an included cell is whole")
        included.append(_combined(fixed, (*firsts, values), budget))
    return included


def _extend(top: Mapping[str, Located], folder: Path, combinations: list[dict[str, Any]], warnings: list[str]) -> None:
    for node in validators.listing(top["extend"]) if "extend" in top else []:
        children = validators.mapping(node, ("where", "set"))
        if "set" not in children or "where" not in children:
            raise node.refuse("both 'where' and 'set' are wanted")
        where = read_filter(children["where"], MATCHABLE)
        changes = {key: read(key, child, folder) for key, child in validators.mapping(children["set"], SETTINGS).items()}
        matched = [combination for combination in combinations if where.matches(combination)]
        if not matched:
            warnings.append(_idle(where))
        for combination in matched:
            limits = combination["budget"].merged(changes.get("budget", {}))
            combination.update({**changes, "budget": limits})


def _idle(idle: Filter) -> str:
    return f"{idle.where}: this filter matches nothing"
