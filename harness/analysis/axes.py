"""Contestants that are equal in all settings but those of some axes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from harness.store.records import Settings
from harness.store.results import Contestant


def others(settings: Settings, *axes: str) -> tuple[Any, ...]:
    """All settings but those of `axes`: equal for contestants that differ in these alone. `size` is width and height."""
    left_out = {*axes, *(("width", "height") if "size" in axes else ())}
    return tuple(getattr(settings, field.name) for field in fields(settings) if field.name not in left_out)


def unlabelled(settings: Settings) -> Settings:
    """Those of the contestant that an A/A twin of these settings repeats."""
    return replace(settings, label="")


def matching(settings: Settings) -> Settings:
    """What has to be equal for contestants of two results folders to be the same."""
    return replace(settings, machine="", division="closed")


def families(contestants: Iterable[Contestant], *axes: str) -> list[list[Contestant]]:
    """Contestants in groups whose members differ in `axes` alone, in the order in which they come."""
    groups: dict[tuple[Any, ...], list[Contestant]] = {}
    for contestant in contestants:
        groups.setdefault(others(contestant.settings, *axes), []).append(contestant)
    return list(groups.values())
