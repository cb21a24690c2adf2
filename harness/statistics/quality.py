"""Time to quality, with bounds where it is not known exactly, and efficiency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from harness.statistics.convergence import CLEAR_ERRORS, Curve
from harness.statistics.crossings import Bound, Crossing, Reading, find_crossing
from harness.statistics.intervals import Estimate, bounded_interval, geometric_interval


@dataclass(frozen=True, slots=True)
class QualityTime:
    """Seconds until the error is `target`: geometric mean over seeds with Student's interval on the logarithms.

    `reached` of `seeds` reached it; `at_first` of those did so at their first checkpoint. `crossings` has the seconds of
    each seed: equal ends where they are known; (0, x] where it was there at its first checkpoint; [x, inf) where it was not
    there after x seconds, and ended or failed. `value` is infinite where some seed did not get there. `reliable`: wherever
    this was decided, the error stood 10 standard errors of the reference's noise above zero; False also where those are
    not known. `reading` is that of `find_crossing`.
    """

    target: float
    value: float
    low: float
    high: float
    reached: int
    at_first: int
    seeds: int
    crossings: tuple[Bound, ...]
    reliable: bool
    reading: Reading

    def verdict(self) -> str:
        """`5/5`, as the tables print it; `5/5 ≤` says that some times are upper bounds."""
        return f"{self.reached}/{self.seeds}{' ≤' if self.at_first else ''}"


def time_to_quality(
    curves: Sequence[Curve], fixed_seconds: Sequence[float], target: float, reading: Reading | None = None
) -> QualityTime:
    """Over seeds: fixed seconds, and the seconds of rendering until the error is `target`.

    `fixed_seconds` is 0 for warm times, import + load + build + compilation for cold ones. Without `reading` it is
    `interpolated` for smooth samplers, `first` for others (see `find_crossing`). Where errors are reproducible, the
    crossing is found in samples, and takes them times the seconds per sample of the whole seed: a mean over the longest
    time that there is. A seed that failed before its first checkpoint has an empty curve.
    """
    own = reading or reading_of(curves)
    found = [crossing_seconds(each, target, own) for each in curves]
    bounds = tuple(Bound(fixed + x.low, fixed + x.high) for fixed, (x, _, _) in zip(fixed_seconds, found, strict=True))
    value, low, high, _ = bounded_interval([bound.low for bound in bounds], [bound.high for bound in bounds])
    states = [crossing.state for crossing in found]
    return QualityTime(
        target,
        value,
        low,
        high,
        reached=len(states) - states.count("censored"),
        at_first=states.count("at_first"),
        seeds=len(states),
        crossings=bounds,
        reliable=all(c.noise <= 1 / CLEAR_ERRORS for c in found),
        reading=own,
    )


def reading_of(curves: Sequence[Curve]) -> Reading:
    """`interpolated` for the curves of a smooth sampler, else `first`."""
    return "interpolated" if curves and all(each.smooth for each in curves) else "first"


def crossing_seconds(each: Curve, target: float, reading: Reading | None = None) -> Crossing:
    """The crossing of one seed in seconds of rendering, by its own reading or another one."""
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
