"""Ratios along each axis, between contestants that are equal in all else, and those that the config's pairs name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import pandas as pd

from engines.choices import Choice
from harness.analysis.baselines import SEVERAL, Baselines, Further
from harness.analysis.comparisons import PAIRS, why_no_ratio
from harness.analysis.model import PER_SAMPLE, Frame, Verdict, group_of, raced_together
from harness.store.results import AXES, CHOICES, Contestant, Results, brief_choice, choices_of, name_words, scope

LABELS = ["axis", "value", "over", "settings"]
OTHER_REFERENCE = "their references differ: each has an image of its own"
"""Why times to a target are not compared."""
Compare = Callable[[Frame, Frame], Frame]
"""`comparisons.comparisons` of `crossings` and `pairs`, its other arguments given."""


Choices = Mapping[tuple[str, str], Sequence[Choice]]
"""See `store.results.choices_of`."""


class Labels(NamedTuple):
    """`value` of the `axis` is compared with the value `over`, both with the same `settings` otherwise, of those that vary."""

    axis: str
    value: str
    over: str
    settings: str


def by_axis(results: Results, verdicts: Sequence[Verdict], crossings: Frame, compare: Compare) -> Frame:
    """One row a contestant, axis (or pair of the config) and measure.

    Columns: those of `comparisons`, and `axis`, `value`, `over` and `settings`, see `Labels`. All ratios along an axis in one
    measure, on all scenes of a machine, are one race: their verdicts hold together (Holm). The axis of a pair of the config is
    `pair`, with all settings in which its sides differ, its values are the names of the contestants.
    """
    judged = {verdict.contestant: verdict for verdict in verdicts}
    found = list(_further(results, verdicts))
    if not found:
        return pd.DataFrame(columns=[*PAIRS, "measure", "ratio", "ratio_low", "ratio_high", "blocks", "verdict", *LABELS])
    labels = _labels(results, found)
    races: dict[tuple[object, ...], list[int]] = {}
    for index, each in enumerate(found):
        same_image = group_of(each.contestant) == group_of(each.baseline)
        races.setdefault((each.axis, each.pair, each.contestant.settings.machine, same_image), []).append(index)
    rows: list[tuple[object, ...]] = []
    said: dict[tuple[int, str], Labels] = {}
    per_sample_only = set()
    for number, ((*_, same_image), members) in enumerate(races.items()):
        if not same_image:
            per_sample_only.add(number)
        compared = {found[index].contestant: index for index in members}
        for index in members:
            compared.setdefault(found[index].baseline, -1)
        for contestant, index in compared.items():
            ranked, name = not judged[contestant].disqualified, _unique(contestant)
            if index < 0:
                rows.append((number, contestant.settings.scene, name, "", "", "the first value", ranked))
                continue
            baseline = found[index].baseline
            said[number, name] = labels[index]
            why_not = why_no_ratio(judged[contestant], judged[baseline])
            rows.append((number, contestant.settings.scene, name, _unique(baseline), labels[index].axis, why_not, ranked))
    unique = crossings.assign(contestant=_unique_names(crossings))
    made = compare(unique, pd.DataFrame(rows, columns=PAIRS))
    made = made[made.baseline != ""]
    words = pd.DataFrame([said[key] for key in zip(made.race, made.contestant, strict=True)], columns=LABELS, index=made.index)
    made = pd.concat([made, words], axis=1)
    other = made.race.isin(per_sample_only) & (made.measure != PER_SAMPLE)
    made.loc[other, "no_ratio"] = made.no_ratio.where(made.no_ratio != "", OTHER_REFERENCE)
    made.loc[other, ["ratio", "ratio_low", "ratio_high"]] = float("nan")
    made.loc[other, "verdict"] = ""
    names = {_unique(one): one.name for one in judged}
    return made.assign(contestant=made.contestant.map(names), baseline=made.baseline.map(names)).reset_index(drop=True)


def _unique(contestant: Contestant) -> str:
    """A name that is no other contestant's on any scene: a race of this module has contestants of several."""
    return f"{contestant.settings.scene}\n{contestant.name}"


def _unique_names(frame: Frame) -> Frame:
    return frame.scene + "\n" + frame.contestant


def _further(results: Results, verdicts: Sequence[Verdict]) -> Iterator[Further]:
    """Along the axes in the order of `AXES`, options behind their choice; then the config's pairs, as far as they are new."""
    baselines = Baselines(results)
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


def _labels(results: Results, found: Sequence[Further]) -> list[Labels]:
    """Those of each ratio. Of the settings that two have in common those are told that vary along their axis."""
    factors, choices = Baselines(results).factors, choices_of([one for one in results.contestants if one.done])
    shared = [_shared(each, choices) if each.axis else {} for each in found]
    varied: dict[tuple[str, str], set[str]] = {}
    for each, words in zip(found, shared, strict=True):
        for key, word in words.items():
            varied.setdefault((each.axis, key), set()).add(word)
    made = []
    for each, words in zip(found, shared, strict=True):
        one, other = each.contestant, each.baseline
        if each.axis:
            settings = " ".join(word for key, word in words.items() if word and len(varied[each.axis, key]) > 1)
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
            rest = [_without(each, found.axis) for each in choices[scope(key, found.contestant)]]
            words[key] = brief_choice(_without(getattr(own, key), found.axis), rest)
    return words


def _without(choice: Choice, option: str) -> Choice:
    return replace(choice, options={name: value for name, value in choice.options.items() if name != option})


def _value(axis: str, one: Contestant, other: Contestant, choices: Choices) -> str:
    """A contestant's value of an axis in words."""
    if axis in AXES:
        return name_words(one, choices)[axis]
    pairs = ((getattr(one.settings, key), getattr(other.settings, key)) for key in CHOICES)
    return next(str(own.options.get(axis)) for own, theirs in pairs if own != theirs)
