"""How far a run's verdicts can be trusted: its own noise, on contestants whose truth is known. See `statistics.calibration`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from harness.analysis.comparisons import clock_steps, own_times
from harness.analysis.crossings import logs
from harness.analysis.model import PER_SAMPLE, Analysis, Frame, Verdict, measure_of, raced_together
from harness.statistics.calibration import BIASED_IMAGE, BIASED_TILE, RaceNoise, bias_figures, race_figures, scaled_residuals
from harness.store.records import Calibration

REPETITIONS = 1000
OF_REPORTS = 200
"""Repetitions of what a report computes about images: nothing is demanded of those figures."""
SEED = 16
MOST_FALSE_WINNERS, LEAST_COVERAGE = 0.065, 0.93
"""What must hold: 5 % and 95 %, with what 1,000 repetitions leave open."""
MOST_FALSE_DIFFERENCES = 0.1
"""Most in a race: 5 % of races have some (Holm), and a baseline that is itself off has several."""
NO_RACES = "no race has two contestants that were timed in each of three or more blocks"
NO_IMAGES = "no contestant has two or more images, of different seeds, beside a reference"


class Figure(NamedTuple):
    """A line of a calibration: its value in words, what it must be, whether it is (None: nothing is demanded)."""

    name: str
    value: str
    expected: str = ""
    holds: bool | None = None


def calibrate(analysis: Analysis, image_repetitions: int = REPETITIONS) -> Calibration:
    """Seeded: the same results give the same figures. An archive keeps those of the run that it is a copy of; one that was made
    by earlier rules keeps those of images."""
    archived = analysis.results.calibration
    if archived is not None and (archived.races is None or archived.races.false_differences is not None):
        return archived
    noises = list(_noises(analysis))
    samples = [verdict.radiance for verdict in analysis.verdicts if verdict.radiance and not verdict.contestant.settings.label]
    times, images = (np.random.default_rng([SEED, part]) for part in range(2))
    races = race_figures(noises, REPETITIONS, times, analysis.results.config.same_within) if noises else None
    of_races: dict[str, Any] = {
        "races": races,
        "race_count": len(noises),
        "repetitions": REPETITIONS,
        "without_twins": sum(not noise.spread.twins for noise in noises),
    }
    if archived is not None:
        return archived.replaced(**of_races)
    bias = bias_figures(samples, image_repetitions, images) if samples else None
    return Calibration(bias=bias, image_count=len(samples), image_repetitions=image_repetitions, **of_races)


def missed(found: Calibration) -> list[str]:
    """What must hold and does not."""
    return [figure.name for figure in figures(found) if figure.holds is False]


def _noises(analysis: Analysis) -> Iterator[RaceNoise]:
    """The races on targets with the times that are known in every block; where there are none, races in seconds per sample."""
    groups = list(raced_together(analysis.verdicts).values())
    times = own_times(analysis.crossings, groups)
    for measures in (map(measure_of, analysis.results.targets), [PER_SAMPLE]):
        races = [(times[number, measure], group) for measure in measures for number, group in enumerate(groups)]
        found = [noise for own, group in races if (noise := _noise(analysis, own, group)) is not None]
        if found:
            yield from found
            return


def _noise(analysis: Analysis, times: Frame, group: Sequence[Verdict]) -> RaceNoise | None:
    """`times`: the rows of `by_race` of the group in one measure."""
    low, high = logs(times, len(group))
    labelled = np.array([bool(verdict.contestant.settings.label) for verdict in group])
    known = ((low == high) & np.isfinite(low)).all(axis=1) & ~labelled
    residuals = scaled_residuals(low[known])
    if residuals is None:
        return None
    spread, clock = analysis.spread(group[0].contestant), float(clock_steps(low[known]).max())
    return RaceNoise(residuals, int(known.sum()), low.shape[1], spread, clock)


def figures(found: Calibration) -> list[Figure]:
    """The six figures, of which the last has two parts, in words."""
    lines: list[Figure] = []
    if found.races is None:
        lines.append(Figure("false winners and differences, coverage, power", f"unknown: {NO_RACES}"))
    else:
        winners, coverage, power, differences = found.races
        lines += [
            Figure(
                "false winners among identical contestants",
                percent(winners),
                f"≤ {percent(MOST_FALSE_WINNERS)}",
                winners <= MOST_FALSE_WINNERS,
            ),
            Figure(
                "false differences in a race of identical contestants",
                "unknown" if differences is None else f"{differences:.2g}",
                f"≤ {MOST_FALSE_DIFFERENCES:g}",
                differences is None or differences <= MOST_FALSE_DIFFERENCES,
            ),
            Figure(
                "coverage of the 95 % intervals", percent(coverage), f"≥ {percent(LEAST_COVERAGE)}", coverage >= LEAST_COVERAGE
            ),
            Figure("5 % slower: called slower", percent(power[0])),
            Figure("20 % slower: called slower", percent(power[1])),
        ]
    if found.bias is None:
        return [*lines, Figure("smallest bias found in 80 %", f"unknown: {NO_IMAGES}")]
    bias = found.bias
    value = (
        f"{percent(bias.smallest_image)} of the whole image, {percent(bias.smallest_tile)} of one tile "
        f"({percent(BIASED_IMAGE)} and {percent(BIASED_TILE)} are found in {percent(bias.found_image)} and "
        f"{percent(bias.found_tile)}; false alarms {percent(bias.false_alarms)})"
    )
    return [*lines, Figure("smallest bias found in 80 %", value)]


def rests_on(found: Calibration) -> str:
    """What the figures are about, in a sentence."""
    races = f"{found.repetitions} synthetic races of each kind from the residuals of {plural(found.race_count, 'race')}"
    images = f"{found.image_repetitions} synthetic images from the noise of {plural(found.image_count, 'contestant')}"
    known = [text for text, part in ((races, found.races), (images, found.bias)) if part is not None]
    if not known:
        return "The run is too small for synthetic contestants."
    bare = found.without_twins
    unknown = f" {bare} of the races have no A/A twins: nothing is called slower there." if bare else ""
    return f"{', and '.join(known)} of this run.{unknown}"


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def percent(share: float) -> str:
    if math.isinf(share):
        return "more than 100 %"
    return f"{100 * share:.3g} %"
