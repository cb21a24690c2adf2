"""Time to quality, with bounds where it is not known exactly, and efficiency."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from harness.statistics.convergence import CLEAR_ERRORS, Curve
from harness.statistics.crossings import Bound, Crossing, Reading, find_crossing
from harness.statistics.intervals import Estimate, bounded_interval, geometric_interval


class QualityTime(NamedTuple):
    """Seconds until an error is reached: geometric mean over seeds with Student's interval on the logarithms.

    `reached` of `seeds` reached it; `at_first` of those did so at their first checkpoint. `seconds` is infinite where some seed
    did not get there; `low` is 0 where some seed was there at its first checkpoint. `reliable`: wherever this was decided, the
    error stood 10 standard errors of the reference's noise above zero; False also where those are not known.
    """

    seconds: float
    low: float
    high: float
    reached: int
    at_first: int
    seeds: int
    reliable: bool


def time_to_quality(crossings: Sequence[Crossing], fixed_seconds: Iterable[float] = ()) -> QualityTime:
    """The time of a contestant to a target. `crossings`: one a seed, each in seconds of rendering, see `crossing_seconds`.

    `fixed_seconds`: import + load + build + compilation of each seed, which are added for cold times; without them times are
    warm.
    """
    fixed = list(fixed_seconds) or [0.0] * len(crossings)
    ends = [[start + crossing.x[end] for start, crossing in zip(fixed, crossings, strict=True)] for end in (0, 1)]
    seconds, low, high, _ = bounded_interval(*ends)
    states = [crossing.state for crossing in crossings]
    reliable = all(crossing.noise <= 1 / CLEAR_ERRORS for crossing in crossings)
    reached, at_first = len(states) - states.count("censored"), states.count("at_first")
    return QualityTime(seconds, low, high, reached, at_first, len(states), reliable)


def reading_of(curves: Sequence[Curve]) -> Reading:
    """`interpolated` for the curves of a smooth sampler, else `first`."""
    return "interpolated" if curves and all(each.smooth for each in curves) else "first"


def crossing_seconds(each: Curve, target: float, reading: Reading | None = None) -> Crossing:
    """The crossing of one seed in seconds of rendering, by its own reading or another one.

    Where errors are reproducible, it is found in samples, and takes them times the seconds per sample of the whole seed: a mean
    over the longest time that there is. A seed that failed before its first checkpoint has an empty curve.
    """
    reading = reading or reading_of([each])
    if not each.reproducible or not each.samples.size:
        return find_crossing(each.seconds, each.error, each.se, target, reading)
    (low, high), state, noise = find_crossing(each.samples, each.error, each.se, target, reading)
    per_sample = float(each.seconds[-1] / each.samples[-1])
    return Crossing(Bound(low * per_sample, high * per_sample if math.isfinite(high) else math.inf), state, noise)


def efficiency(mse: Sequence[float], seconds: Sequence[float]) -> Estimate:
    """1 / (MSE x time) (Pharr, Jakob and Humphreys, "Efficiency"): geometric mean over seeds with its interval.

    NaN for a seed whose error is not positive or not finite.
    """
    pairs = zip(mse, seconds, strict=True)
    return geometric_interval([1 / (e * t) if math.isfinite(e * t) and e > 0 and e * t > 0 else math.nan for e, t in pairs])
