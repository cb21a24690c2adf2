"""Races of engines that trace the same rays with as many threads: rates, ratios and wrong answers of each contestant."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from engines.choices import Choice
from harness.analysis.axes import is_named
from harness.analysis.comparisons import clock_steps
from harness.config.settings import RAY_KINDS, Combination
from harness.statistics import (
    UNKNOWN_SPREAD,
    Estimate,
    PersistentSpread,
    Ratio,
    TwinPair,
    persistent_spread,
    proportion_interval,
    race,
    twin_pairs,
)
from harness.store.records import BROKEN, Answers, RayCell, RaySettings
from harness.store.results import Results, brief_choice


@dataclass(frozen=True)
class RayContestant:
    """A configuration that traces the rays of a set, with its cells by block. `accelerator` has those options alone in which
    accelerators of its name differ. `ratio` is that of its rate over the baseline's; None of the baseline, and where there is
    nothing to compare. `spread`: what persists between equal contestants of its machine."""

    settings: RaySettings
    accelerator: str = field(compare=False)
    cells: tuple[RayCell, ...] = field(compare=False)
    baseline: bool = field(default=False, compare=False)
    ratio: Ratio | None = field(default=None, compare=False)
    spread: PersistentSpread = field(default=UNKNOWN_SPREAD, compare=False)

    @cached_property
    def done(self) -> list[RayCell]:
        """Cells that were measured to their end."""
        return [cell for cell in self.cells if cell.state == "done" and cell.passes]

    @cached_property
    def timed(self) -> list[RayCell]:
        """Those of `done` whose calls took longer than the clock resolves."""
        return [cell for cell in self.done if cell.seconds > 0]

    @property
    def judged(self) -> list[bool]:
        """Whether other work disturbed a block, of those of which that is known."""
        return [cell.machine.contended for cell in self.done if cell.machine.contended is not None]

    @property
    def told_by(self) -> RayCell:
        """The cell that says what became of it: one that is broken, else one that is done, else any."""
        broken = [cell for cell in self.cells if cell.state in BROKEN]
        return (broken or self.done or self.cells)[0]

    @property
    def answers(self) -> Answers | None:
        """What was wrong with its answers in the first block that was measured."""
        return next((cell.answers for cell in self.done), None)

    @property
    def error_rate(self) -> Estimate:
        """Share of the checked answers that are wrong in any way, with its exact interval; NaN without answers."""
        return proportion_interval(self.answers.faults, self.answers.checked) if self.answers else proportion_interval(0, 0)

    @property
    def leak_rate(self) -> Estimate:
        """Share of the hard rays that went through, as `error_rate`."""
        return proportion_interval(self.answers.leaks, self.answers.hard) if self.answers else proportion_interval(0, 0)

    @property
    def unstable(self) -> bool:
        """Whether its answers were not the same in all blocks."""
        return len({cell.answers.sha256 for cell in self.done if cell.answers}) > 1

    @property
    def variant(self) -> str:
        """Accelerator and precision, where they are not left to the engine."""
        return " ".join(filter(None, ["" if self.accelerator == "auto" else self.accelerator, self.settings.precision]))

    def rates(self, cpu: bool = False) -> list[float]:
        """Million rays per second of each timed block: of wall time, or of processor time as far as that is known."""
        seconds = [(cell.machine.cpu_seconds or math.nan) if cpu else cell.seconds for cell in self.timed]
        return [1e-6 * cell.count * cell.passes / s for cell, s in zip(self.timed, seconds, strict=True)]


def ray_races(results: Results) -> list[list[RayContestant]]:
    """Contestants by scene, set of rays, threads and machine, in each race in the order in which they are baselines: those that
    the config's `baseline` matches, then as the config writes them, then by the engine's name."""
    cells: dict[tuple[RaySettings, str], list[RayCell]] = {}
    for cell in results.ray_cells:
        cells.setdefault((cell.settings, cell.ray_set_id), []).append(cell)
    accelerators: dict[str, list[Choice]] = {}
    for settings, _ in cells:
        accelerators.setdefault(settings.engine, []).append(settings.accelerator)
    found = [
        RayContestant(s, brief_choice(s.accelerator, accelerators[s.engine]), tuple(sorted(own, key=lambda cell: cell.block)))
        for (s, _), own in cells.items()
    ]
    scenes = list(dict.fromkeys([*(each.scene.name for each in results.config.combinations), *(s.scene for s, _ in cells)]))
    named, written = results.config.baseline, results.config.combinations
    names = {each.engine for each in written}

    def place(one: RayContestant) -> tuple[Any, ...]:
        s = one.settings
        shared = [_shared(each, s, names) for each in written]
        own = shared.index(max(shared)) if shared else 0
        other = named is not None and not named.matches(s)
        return scenes.index(s.scene), RAY_KINDS.index(s.rays), s.threads, other, own, s.engine, s.label

    races: dict[tuple[str, ...], list[RayContestant]] = {}
    for one in sorted(found, key=place):
        s = one.settings
        races.setdefault((s.scene, s.rays, str(s.threads), s.machine, one.cells[0].ray_set_id), []).append(one)
    timed = [_Times(group) for group in races.values()]
    pairs: dict[str, list[TwinPair]] = {}
    for each in timed:
        pairs.setdefault(each.machine, []).extend(each.twin_pairs)
    spreads = {machine: persistent_spread(found) for machine, found in pairs.items()}
    return [each.raced(spreads[each.machine], results.config.same_within) for each in timed]


def _shared(written: Combination, found: RaySettings, names: Iterable[str]) -> int:
    """How many settings of a combination these are; it may leave options out. `names` are those of the config's engines."""
    return (
        (written.scene.name == found.scene)
        + is_named(written.engine, found.engine, names)
        + (written.accelerator.describe().items() <= found.accelerator.describe().items())
        + sum(getattr(written, key) == getattr(found, key) for key in ("rays", "precision", "threads"))
    )


class _Times:
    """The times of a race: ln seconds a pass, of its members that are measured and not broken; `clock` is what
    it resolves of these, for each pass is timed."""

    def __init__(self, group: Sequence[RayContestant]) -> None:
        self.group = group
        self.machine = group[0].settings.machine
        self.timed = [row for row, one in enumerate(group) if one.timed and one.told_by.state == "done"]
        self.ranked = np.array([row in self.timed and not one.settings.label for row, one in enumerate(group)])
        blocks = np.unique([cell.block for row in self.timed for cell in group[row].timed])
        self.logs = np.full((len(group), len(blocks)), math.nan)
        for row in self.timed:
            for cell in group[row].timed:
                self.logs[row, np.searchsorted(blocks, cell.block)] = math.log(cell.seconds / cell.passes)
        self.clock = clock_steps(self.logs)

    @property
    def twin_pairs(self) -> list[TwinPair]:
        rows = {self.group[row].settings: row for row in self.timed}
        twins = [(rows.get(replace(one, label="")), row) for one, row in rows.items() if one.label]
        known = [(original, twin) for original, twin in twins if original is not None]
        return twin_pairs(self.logs, self.logs, known, ranked=self.ranked, clock=self.clock)

    def raced(self, spread: PersistentSpread, same_within: float) -> list[RayContestant]:
        """The contestants with their ratios to the first that is measured, none of them broken."""
        if not self.ranked.any():
            return list(self.group)
        base = int(np.flatnonzero(self.ranked)[0])
        others = [row for row in self.timed if row != base]
        compared = [(row, base) for row in others]
        found = race(self.logs, self.logs, compared, spread, ranked=self.ranked, clock=self.clock, margin=same_within)
        ratios = dict(zip(others, found.ratios, strict=True))
        return [replace(one, baseline=row == base, ratio=ratios.get(row), spread=spread) for row, one in enumerate(self.group)]
