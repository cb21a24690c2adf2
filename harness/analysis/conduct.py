"""Flags of what a contestant did with seeds, samples, the reference, threads and time.

All are read from events, so that archives without images have them too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

from harness.statistics import BiasEstimate, mean_interval
from harness.statistics.bias import ROUNDED
from harness.store.records import Machine, Point
from harness.store.results import Contestant

CORRELATED_Z = 5.0
"""Standard errors by which products of differences from the two halves of a reference are negative, if noise is shared."""
NOISIER = 1.3
"""Times the variance that a film's own samples let expect, if they are independent."""
FEWEST_SAMPLES = 4
"""Below these the variance of a film's samples is too rough."""
MORE_THREADS, LEAST_MORE = 0.25, 0.6
"""Runnable threads beyond those allowed, as a share of these, and at least: the thread that calls takes turns with those that
it starts, and on a busy machine both may wait for a moment."""
OFF_CLOCK_SHARE, OFF_CLOCK_SECONDS = 0.1, 0.05
"""Processor time of a cell between timed calls, over that within them, and at least: thread pools take a moment to rest."""


def conduct_flags(contestant: Contestant, bias: BiasEstimate | None) -> list[str]:
    """Names, of `analysis.model.FLAGS`; `bias` where there are images."""
    seen = {
        **seed_flags(contestant),
        "reference_copied": copies_reference(contestant, bias),
        "fewer_samples": not (bias and bias.biased) and has_fewer_samples(contestant),
        "too_many_threads": uses_more_threads(contestant),
        "works_between_calls": works_between_calls(contestant),
    }
    return [name for name, found in seen.items() if found]


def seed_flags(contestant: Contestant) -> dict[str, bool]:
    """`ignores_seed`: all images of different seeds are equal at equal samples; `stale_image`: some are.

    Images are equal where all their metrics are, to the last digit, and they show noise: scenes may have none.
    """
    equal = [_fingerprint(a) == _fingerprint(b) for a, b in _same_samples(contestant)]
    return {"ignores_seed": bool(equal) and all(equal), "stale_image": any(equal) and not all(equal)}


def _same_samples(contestant: Contestant) -> Iterator[tuple[Point, Point]]:
    """Checkpoints of two cells, of different seeds, at the same samples, where the reference has noise."""
    for one, other in combinations(contestant.done, 2):
        theirs = {point.spp: point for point in other.points}
        for point in one.points:
            if one.seed != other.seed and point.spp in theirs and _noisy(point):
                yield point, theirs[point.spp]


def _noisy(point: Point) -> bool:
    """Whether the reference has noise above rounding: by its variance the correction lowers the mean squared error."""
    names = ("mse", "mse_corrected", "mean_r", "mean_g", "mean_b")
    error, corrected, *means = (point.metrics.get(name) or 0.0 for name in names)
    return error - corrected > (ROUNDED * max(means)) ** 2


def _fingerprint(point: Point) -> tuple[float | None, ...]:
    return tuple(value for _, value in sorted(point.metrics.items()))


def copies_reference(contestant: Contestant, bias: BiasEstimate | None) -> bool:
    """Whether the images share the noise of the reference's halves R1, R2.

    Of an image A that is independent of them the mean of (A - R1)(A - R2) is its variance plus its squared bias, never
    negative. If A holds the shares c1 and c2 of their noise, it is less by c1 (1 - c1) var(R1) + c2 (1 - c2) var(R2).
    Looked for at each cell's last checkpoint, and over pairs of seeds (A - R1)(B - R2), free of the images' own noise.
    """
    if bias is not None and bias.squared < -CORRELATED_Z * bias.se:
        return True
    ends = [cell.end for cell in contestant.done]
    errors = [tuple(end.metrics.get(name) for name in ("mse_corrected", "mse_se")) for end in ends if _noisy(end)]
    known = [(error, se) for error, se in errors if error is not None and se is not None]
    return bool(known) and all(error < -CORRELATED_Z * se for error, se in known)


def has_fewer_samples(contestant: Contestant) -> bool:
    """Whether errors exceed, by more than `NOISIER` at 99 % over blocks, what the spread of as many samples explains.

    At the first checkpoint of `FEWEST_SAMPLES` or more, where a bias is least of the error. The mean squared error of a film of
    independent samples is its `film_variance`. For points that depend on each other nothing is expected: few Halton points may
    err more than independent ones.
    """
    if not all(cell.smooth_sampler for cell in contestant.done):
        return False
    logs = []
    for cell in contestant.done:
        varied = [(p.film_variance, p) for p in cell.points if p.spp >= FEWEST_SAMPLES and p.film_variance is not None]
        variance, error = (varied[0][0], varied[0][1].metrics.get("mse_corrected")) if varied else (0.0, None)
        if error is None or not 0 < error < math.inf:
            return False
        logs.append(math.log(error / variance) if variance > 0 else math.inf)
    if len(logs) > 1 and all(math.isinf(value) for value in logs):
        return not any(seed_flags(contestant).values())
    return bool(mean_interval(logs, 0.99).low > math.log(NOISIER))


def uses_more_threads(contestant: Contestant) -> bool:
    """Whether on average more threads ran, or waited for a processor, than the settings allow.

    On a busy machine too many threads take no more processor time, but they wait.
    """
    runnable, most = 0.0, OFF_CLOCK_SECONDS
    for machine, threads in _machines(contestant):
        runnable += (machine.cpu_seconds or 0.0) + (machine.run_queue_seconds or 0.0)
        most += (machine.timed_seconds or 0.0) * (threads + max(MORE_THREADS * threads, LEAST_MORE))
    return runnable > most


def works_between_calls(contestant: Contestant) -> bool:
    """Whether threads of the engine used a processor when nothing was asked of them, in every cell."""
    found = [
        (machine.off_clock_cpu_seconds or 0.0) > max(OFF_CLOCK_SHARE * (machine.cpu_seconds or 0.0), OFF_CLOCK_SECONDS)
        for machine, _ in _machines(contestant)
    ]
    return bool(found) and all(found)


def _machines(contestant: Contestant) -> Iterator[tuple[Machine, int]]:
    for cell in contestant.done:
        yield cell.machine, cell.threads
