"""Contestants that differ along one axis alone, compared with each other over all that is held fixed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from harness.analysis import Analysis, axes, seconds_per_sample
from harness.analysis.comparisons import race_of
from harness.report.tables import Column
from harness.statistics import NO_SPREAD, Bound, Estimate, Race, Ratio, geometric_interval
from harness.store.results import Contestant, choices_of, name_words


class Measure(NamedTuple):
    """`values`: block -> a positive number of which less is better. `timed`: whether they are times, in which equal contestants
    differ; else a computer repeats them. `kind`: contestants of different kinds are also compared by each of the `readings`."""

    values: Callable[[Contestant], Mapping[int, float]]
    timed: bool
    kind: Callable[[Contestant], str] | None = None
    readings: Sequence[Callable[[Contestant], Mapping[int, Bound]]] = ()


SPEEDS = Measure(seconds_per_sample, timed=True)


HEADINGS = {
    "scene": Column("scene", "Scene that was rendered."),
    "shader": Column("shader", "Light-transport rule."),
    "accelerator": Column("accelerator", "Engine and accelerator."),
    "sampler": Column("sampler", "Sampler."),
    "threads": Column("threads", "Threads."),
    "size": Column("size", "Pixels."),
    "machine": Column("machine", "Machine."),
    "precision": Column("precision", "Numbers it computes with."),
}
"""Columns in which families differ."""
AXES: Mapping[str, Sequence[str]] = {
    "accelerator": ("engine", "accelerator", "precision"),
    **{axis: (axis,) for axis in ("threads", "shader", "sampler")},
}
"""What may vary within a family, with the settings in which it then may differ: a value of `accelerator` is an engine with its
accelerator."""


@dataclass(frozen=True)
class Family:
    """`members` by their value on the axis; `held` is what all of them share, in words, by the keys of `HEADINGS`."""

    held: Mapping[str, str]
    members: Mapping[str, Contestant]

    @property
    def scene(self) -> str:
        return self.held["scene"]

    @property
    def shader(self) -> str:
        return self.held.get("shader", "")

    @property
    def any(self) -> Contestant:
        return next(iter(self.members.values()))


def families_along(analysis: Analysis, axis: str) -> list[Family]:
    """Groups of two or more measured contestants that differ along `axis` alone; A/A labels and the open division are left out.

    `axis` is one of `AXES`.
    """
    named = {id(contestant): each for each, contestant in named_contestants(analysis)}
    left_out = {axis, *(("precision",) if axis == "accelerator" else ())}
    families = []
    for group in axes.families([contestant for _, contestant in named_contestants(analysis)], *AXES[axis]):
        held = {key: word for key, word in named[id(group[0])].items() if key not in left_out}
        families.append(Family(held, {named[id(contestant)][axis]: contestant for contestant in group}))
    return [family for family in families if len(family.members) > 1]


def named_contestants(analysis: Analysis) -> list[tuple[dict[str, str], Contestant]]:
    """The measured contestants of the closed division, A/A labels left out, each with its words by the keys of `HEADINGS`."""
    measured = [c for c in analysis.results.contestants if c.done and not c.settings.label and c.settings.division == "closed"]
    choices, found = choices_of(measured), []
    for contestant in measured:
        named = name_words(contestant, choices) | {"scene": contestant.settings.scene}
        named["accelerator"] = accelerator_name(named["engine"], named["accelerator"])
        found.append(({key: named[key] for key in HEADINGS}, contestant))
    return found


def accelerator_name(engine: str, accelerator: str) -> str:
    """`numba bvh`, but `embree` for Embree's own, and the engine alone where it chose."""
    return engine if accelerator in (engine, "auto", "") else f"{engine} {accelerator}"


def identity(families: Sequence[Family]) -> list[Column]:
    """The columns that a table of these families needs: the scene, and what else differs among them."""
    return [column for key, column in HEADINGS.items() if key == "scene" or len({f.held.get(key) for f in families}) > 1]


def values(families: Sequence[Family]) -> list[str]:
    """Every value that occurs, in the order of first appearance."""
    return list(dict.fromkeys(value for family in families for value in family.members))


def value_columns(families: Sequence[Family], meaning: str, heading: str = "{}") -> list[Column]:
    """A column of estimates for each value that occurs; `{}` in the words stands for it."""
    return [Column(value, meaning.format(value), "estimate", heading.format(value)) for value in values(families)]


def row_of(family: Family, number: Callable[[Contestant], Estimate], **more: Any) -> dict[str, Any]:
    """A row of a table with `value_columns`: what the family holds, a number for each member, and `more`."""
    return {**family.held, **{value: number(contestant) for value, contestant in family.members.items()}, **more}


def compare(analysis: Analysis, family: Family, one: str, other: str, measure: Measure = SPEEDS) -> Ratio:
    """Of two members, paired by block; the verdicts of all pairs of a family hold together."""
    names = list(family.members)
    asked = names.index(one), names.index(other)
    pairs = [asked if set(pair) == set(asked) else pair for pair in combinations(range(len(names)), 2)]
    return _race(analysis, family, names, pairs, measure).ratios[pairs.index(asked)]


def speedups(analysis: Analysis, family: Family, over: str) -> dict[str, Estimate]:
    """By member, how many times as fast it is as the member `over`; nothing where the family lacks that."""
    others = [name for name in family.members if name != over] if over in family.members else []
    return {name: Estimate(*compare(analysis, family, name, over)[:4]) for name in others}


def _race(analysis: Analysis, family: Family, names: Sequence[str], pairs: Sequence[tuple[int, int]], measure: Measure) -> Race:
    spread = analysis.spread(family.any) if measure.timed else NO_SPREAD
    margin, members = analysis.results.config.same_within, [family.members[name] for name in names]
    own = [measure.values(member) for member in members]
    kinds = np.array([measure.kind(member) for member in members]) if measure.kind else np.empty(0)
    if len(set(kinds)) < 2:
        return race_of(own, pairs, spread, margin)
    readings = [[reading(member) for member in members] for reading in measure.readings]
    return race_of(own, pairs, spread, margin, readings, kinds[:, None] != kinds)


def ranking(family: Family, measure: Measure = SPEEDS) -> list[str]:
    """Values of a family from the least to the greatest mean; those without a measure are left out."""
    means = {value: estimate(measure.values(contestant)).value for value, contestant in family.members.items()}
    return sorted((value for value, mean in means.items() if not math.isnan(mean)), key=lambda v: means[v])


def demanding(families: Sequence[Family], keys: Sequence[str] = ("scene",)) -> list[Family]:
    """One family a scene (or what else of `HEADINGS`): that of the shader whose samples take most rays over all of them."""
    rays: dict[str, list[float]] = {}
    for family in families:
        end = family.any.done[0].end
        rays.setdefault(family.shader, []).append((end.rays or 0.0) / end.spp)
    order = sorted(rays, key=lambda shader: -sum(rays[shader]) / len(rays[shader]))
    chosen: dict[tuple[str, ...], Family] = {}
    for family in sorted(families, key=lambda family: order.index(family.shader)):
        chosen.setdefault(tuple(family.held[key] for key in keys), family)
    return [family for family in families if family in chosen.values()]


def usual(families: Sequence[Family], key: str) -> list[Family]:
    """The families with the value of `key` that most of them have."""
    counts = Counter(family.held[key] for family in families)
    return [family for family in families if family.held[key] == counts.most_common(1)[0][0]]


def best(analysis: Analysis, family: Family, measure: Measure = SPEEDS) -> list[str]:
    """The values that may be the best, the one with the least mean first."""
    order = ranking(family, measure)
    possible = _race(analysis, family, order, [], measure).possible_winner
    return [value for value, may in zip(order, possible, strict=True) if may]


def thousands(contestant: Contestant) -> Estimate:
    """Thousands of paths (samples of a pixel) per second: geometric mean over blocks with its interval."""
    scale = 1e-3 * pixels(contestant)
    return estimate({block: scale / seconds for block, seconds in seconds_per_sample(contestant).items()})


def pixels(contestant: Contestant) -> int:
    return contestant.settings.width * contestant.settings.height


def estimate(measure: Mapping[int, float], factor: float = 1.0) -> Estimate:
    """Geometric mean over blocks with its interval."""
    return geometric_interval([factor * value for value in measure.values()])
