"""Ratios along each axis, between contestants that are equal in all else, and those that the config's pairs name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from engines.choices import Choice
from harness.analysis.axes import option_of
from harness.analysis.baselines import SEVERAL, Baselines, Further
from harness.analysis.comparisons import PAIRS, RATIOS, Spreads, comparisons, why_no_ratio
from harness.analysis.model import PER_SAMPLE, Frame, Verdict, group_of, raced_together
from harness.store.results import AXES, CHOICES, Contestant, Results, brief_choice, choices_of, name_words, scope

LABELS = ["axis", "value", "over", "settings"]
OTHER_REFERENCE = "their references differ: each has an image of its own"
"""Why times to a target are not compared."""


Choices = Mapping[tuple[str, str], Sequence[Choice]]
"""See `store.results.choices_of`."""


class Labels(NamedTuple):
    """`value` of the `axis` is compared with the value `over`, both with the same `settings` otherwise, of those that vary."""

    axis: str
    value: str
    over: str
    settings: str


def by_axis(results: Results, verdicts: Sequence[Verdict], crossings: Frame, spreads: Spreads) -> Frame:
    """One row a contestant, axis (or pair of the config) and measure.

    Columns: those of `comparisons`, and `axis`, `value`, `over` and `settings`, see `Labels`. All ratios along an axis in one
    measure, on all scenes of a machine, are one race: their verdicts hold together (Holm). The axis of a pair of the config is
    `pair`, with all settings in which its sides differ, its values are the names of the contestants.
    """
    baselines, judged = Baselines(results), {verdict.contestant: verdict for verdict in verdicts}
    found = list(_further(baselines, verdicts))
    if not found:
        return pd.DataFrame(columns=[*PAIRS, "measure", *RATIOS, *LABELS])
    labels = dict(zip(found, _labels(results, baselines, found), strict=True))
    races = _races(found)
    rows = [row for number, members in enumerate(races) for row in _pairs(number, members, judged)]
    made = comparisons(crossings, pd.DataFrame(rows, columns=PAIRS), spreads, results.config.same_within)
    made = made[made.baseline != ""]
    told = {
        (number, each.contestant.settings.scene, each.contestant.name): each
        for number, members in enumerate(races)
        for each in members
    }
    own = [told[key] for key in zip(made.race, made.scene, made.contestant, strict=True)]
    made = pd.concat([made, pd.DataFrame([labels[each] for each in own], columns=LABELS, index=made.index)], axis=1)
    other = np.array([not _same_image(each) for each in own]) & (made.measure != PER_SAMPLE)
    made.loc[other, "no_ratio"] = made.no_ratio.where(made.no_ratio != "", OTHER_REFERENCE)
    made.loc[other, ["ratio", "ratio_low", "ratio_high"]] = math.nan
    made.loc[other, "verdict"] = ""
    return made.reset_index(drop=True)


def _races(found: Sequence[Further]) -> list[list[Further]]:
    """Those of each axis, or pair of the config, on a machine; those whose sides have different references apart, for of these
    seconds per sample are compared alone."""
    races: dict[tuple[object, ...], list[Further]] = {}
    for each in found:
        key = each.axis, each.pair, each.contestant.settings.machine, _same_image(each)
        races.setdefault(key, []).append(each)
    return list(races.values())


def _same_image(each: Further) -> bool:
    return group_of(each.contestant) == group_of(each.baseline)


def _pairs(number: int, members: Sequence[Further], judged: Mapping[Contestant, Verdict]) -> Iterator[tuple[object, ...]]:
    """The rows of a race as `comparisons.pairs` has them."""
    compared = {each.contestant: each for each in members}
    for contestant in dict.fromkeys([*compared, *(each.baseline for each in members)]):
        key, ranked = (number, contestant.settings.scene, contestant.name), not judged[contestant].disqualified
        each = compared.get(contestant)
        if each is None:
            yield *key, "", "", "the first value", ranked
        else:
            why_not = why_no_ratio(judged[contestant], judged[each.baseline])
            yield *key, each.baseline.name, each.axis, why_not, ranked


def _further(baselines: Baselines, verdicts: Sequence[Verdict]) -> Iterator[Further]:
    """Along the axes in the order of `AXES`, options behind their choice; then the config's pairs, as far as they are new."""
    groups: dict[tuple[object, ...], list[Contestant]] = {}
    for verdict in verdicts:
        settings = verdict.contestant.settings
        key = settings.scene, settings.size, settings.machine, settings.division
        groups.setdefault(key, []).append(verdict.contestant)
    along = [each for group in groups.values() for each in baselines.along_axes(group)]
    order = {axis: place for place, axis in enumerate(AXES)}
    yield from sorted(along, key=lambda each: order.get(each.axis, len(order)))
    known = {frozenset(each[:2]) for each in along}
    for group in raced_together(verdicts).values():
        members = [verdict.contestant for verdict in group]
        known |= {frozenset((one, base.contestant)) for one in members if (base := baselines.of(one, members)) is not None}
        yield from (each for each in baselines.of_pairs(members) if frozenset(each[:2]) not in known)


def _labels(results: Results, baselines: Baselines, found: Sequence[Further]) -> list[Labels]:
    """Those of each ratio. Of the settings that two have in common those are told that vary along their axis."""
    factors, choices = baselines.factors, choices_of([one for one in results.contestants if one.done])
    shared = [_shared(each, choices) if each.axis else {} for each in found]
    varied: dict[tuple[str, str, str], set[str]] = {}

    def place(each: Further, key: str) -> tuple[str, str, str]:
        """Among whom a setting must vary to be told: sizes in a scene, others along the axis."""
        return each.axis, key, each.contestant.settings.scene if key == "size" else ""

    for each, words in zip(found, shared, strict=True):
        for key, word in words.items():
            varied.setdefault(place(each, key), set()).add(word)
    made = []
    for each, words in zip(found, shared, strict=True):
        one, other = each.contestant, each.baseline
        if each.axis:
            told = (word for key, word in words.items() if word and len(varied[place(each, key)]) > 1)
            settings = " ".join(dict.fromkeys(told))  # embree's accelerator is embree
            made.append(
                Labels(each.axis, _value(each.axis, one, other, choices), _value(each.axis, other, one, choices), settings)
            )
        else:
            made.append(Labels(f"pair ({SEVERAL.join(factors(one, other))})", one.name, other.name, ""))
    return made


def _shared(found: Further, choices: Choices) -> dict[str, str]:
    """The words of the settings that two have in common: all but the axis; of a choice all options but that."""
    own, other = found.contestant.settings, found.baseline.settings
    words = name_words(found.contestant, choices)
    for key in AXES:
        if key in ("label", found.axis) or (
            key == "accelerator" and own.engine != other.engine and own.accelerator != other.accelerator
        ):
            del words[key]
        elif key in CHOICES and getattr(own, key) != getattr(other, key):
            option = option_of(found.axis)
            rest = [_without(each, option) for each in choices[scope(key, found.contestant)]]
            words[key] = brief_choice(_without(getattr(own, key), option), rest)
    return words


def _without(choice: Choice, option: str) -> Choice:
    return replace(choice, options={name: value for name, value in choice.options.items() if name != option})


def _value(axis: str, one: Contestant, other: Contestant, choices: Choices) -> str:
    """A contestant's value of an axis in words."""
    words = name_words(one, choices)
    several = len(choices[scope("accelerator", one)]) > 1
    if axis == "engine" and several and one.settings.accelerator != other.settings.accelerator:  # it is part of the engine
        return f"{words['engine']} {words['accelerator']}"
    if axis in AXES:
        return words[axis]
    pairs = ((getattr(one.settings, key), getattr(other.settings, key)) for key in CHOICES)
    return next(str(own.options.get(option_of(axis))) for own, theirs in pairs if own != theirs)
