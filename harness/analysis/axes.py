"""Contestants that are equal in all settings but those of some axes, and in what two of them differ.

An axis is a setting (engine, accelerator, shader, sampler, precision, threads) or an option of a choice (`light_sampler`;
`accelerator.threads` where a setting, or another choice, has one of that name, too).
`auto` of two engines is one setting. The accelerator counts as part of the engine where two engines have none in common and one
of them has a single one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from engines.choices import Choice
from engines.registry import split
from harness.config.settings import Combination
from harness.store.records import Settings
from harness.store.results import AXES, CHOICES, Contestant, Results

SETTINGS = ("engine", "accelerator", "shader", "sampler", "precision", "threads")
"""The settings in which contestants of a race may differ."""


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


# --- differences ----------------------------------------------------------------------------------------------------


def accelerators_of(contestants: Iterable[Contestant]) -> dict[str, set[Choice]]:
    """Engine -> the accelerators that it has among these contestants."""
    found: dict[str, set[Choice]] = {}
    for contestant in contestants:
        found.setdefault(contestant.settings.engine, set()).add(contestant.settings.accelerator)
    return found


def differences(one: Settings, other: Settings, accelerators: Mapping[str, set[Choice]]) -> list[str]:
    """The axes in which two differ: of choices of one name the options. `accelerators`: those of each engine, see
    `accelerators_of`."""
    found = []
    for key in SETTINGS:
        here, there = getattr(one, key), getattr(other, key)
        if here == there or (key == "accelerator" and _of_the_engine(one, other, accelerators)):
            continue
        same_name = key in CHOICES and here.name == there.name
        found += _options(key, one, other) if same_name else [key]
    return found


def option_of(axis: str) -> str:
    """The name of the option that an axis is, without that of its choice."""
    return axis.rpartition(".")[2]


def _of_the_engine(one: Settings, other: Settings, accelerators: Mapping[str, set[Choice]]) -> bool:
    """Whether the accelerators of two engines are part of these."""
    if one.engine == other.engine:
        return False
    if one.accelerator.name == other.accelerator.name == "auto":
        return True
    here, there = accelerators[one.engine], accelerators[other.engine]
    shared = {each.name for each in here} & {each.name for each in there}
    return not shared and 1 in (len(here), len(there))


def _options(key: str, one: Settings, other: Settings) -> list[str]:
    """The options in which two choices of one name differ; with the choice, where a setting or another choice has the name."""
    here, there = getattr(one, key).options, getattr(other, key).options
    taken = {*AXES, *(name for rest in CHOICES if rest != key for side in (one, other) for name in getattr(side, rest).options)}
    names = [name for name in dict.fromkeys([*here, *there]) if here.get(name) != there.get(name)]
    return [f"{key}.{name}" if name in taken else name for name in names]


# --- the order in which a config writes contestants -----------------------------------------------------------------


def places(results: Results) -> dict[Settings, int]:
    """Contestants -> the place of each in the order of the config, in which the first value of every axis comes first: that of
    the first combination that has most of its settings, all of them where the config is that of the run."""
    written = results.config.combinations
    names = {one.engine for one in written}

    def alike(one: Combination, settings: Settings) -> int:
        """How many settings of a combination agree with these. What it leaves to engine and scene agrees with everything."""
        return (
            (one.rays is None)
            + (one.scene.name == settings.scene)
            + is_named(one.engine, settings.engine, names)
            + (one.threads == settings.threads)
            + (one.precision in (None, settings.precision))
            + (one.resolution in (None, settings.resolution))
            + (one.division == settings.division)
            + sum(_is_written(getattr(one, key), getattr(settings, key)) for key in CHOICES)
        )

    found = {}
    for contestant in results.contestants:
        shared = [alike(one, contestant.settings) for one in written]
        found[contestant.settings] = shared.index(max(shared)) if shared else 0
    return found


def _is_written(written: Choice | None, choice: Choice) -> bool:
    """Whether a choice has the name and the options of the written one, or none is written. Those of its options that are
    written nowhere do not matter; those that descriptions leave out do."""
    return written is None or (written.name == choice.name and written.options.items() <= choice.options.items())


def is_named(written: str, engine: str, names: Iterable[str]) -> bool:
    """Whether a config's engine may be that of tables. Of code, a file and a Python of its own the name is not known here."""
    if written == engine:
        return True
    base, python = split(written)
    if python is not None and ":" not in base:
        return engine.partition(" ")[0] == base
    return engine not in names and (":" in written or written.endswith((".yaml", ".yml")))
