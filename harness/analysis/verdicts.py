"""What the results say: every contestant's verdict, computed once for the tables, the plots and the report."""

from __future__ import annotations

import math
from collections.abc import Mapping

from harness.analysis import archived_verdicts
from harness.analysis.archived_verdicts import FromImages
from harness.analysis.axes import places
from harness.analysis.baselines import engine_order, nearest_of_engine
from harness.analysis.conduct import conduct_flags
from harness.analysis.equivalence import Replicates, compared, engine_pairs, pictured_spp, shared_spp
from harness.analysis.image_flags import image_flags
from harness.analysis.model import Analysis, Group, Verdict, group_of
from harness.analysis.slopes import slopes
from harness.metrics import as_error
from harness.statistics import (
    BiasEstimate,
    Equivalence,
    Slope,
    bias_estimate,
    efficiency,
    geometric_interval,
    too_good_per_sample,
)
from harness.statistics.bias import RadianceSample, radiance_sample
from harness.statistics.equivalence import shared_alpha
from harness.store.records import Cell, Point
from harness.store.results import PHASES, Contestant, Results, phase_seconds, point_error


def analyse(results: Results) -> Analysis:
    """Draws all conclusions; reads the last image of every cell for bias and equivalence."""
    from harness.analysis import by_axis, comparisons, crossings, measurements  # pandas, which takes half a second to import

    images, known, engine = Replicates(results), archived_verdicts.read_archived(results), baseline_engine_of(results)
    slope_of = slopes(results)
    measured = [contestant for contestant in results.contestants if contestant.done]
    closed: dict[Group, list[Contestant]] = {}
    written = places(results)
    for contestant in sorted(measured, key=lambda c: written[c.settings]):  # of contestants as near the first as written counts
        if contestant.settings.division == "closed":
            closed.setdefault(group_of(contestant), []).append(contestant)
    found = {
        contestant: _verdict(results, contestant, closed, engine, slope_of[contestant.settings], images, known)
        for contestant in sorted(measured, key=lambda c: (c.settings.scene, c.settings.shader))  # those that share images
    }
    verdicts = [found[contestant] for contestant in measured]
    targets = dict(zip(results.targets, error_targets(results), strict=True))
    points, cells = measurements.points(results), measurements.cells(results)
    crossed = crossings.crossings(points.frame, cells.frame, targets)
    pairs = comparisons.pairs(results, verdicts)
    spreads = comparisons.persistent_spreads(crossed, verdicts)
    return Analysis(
        results,
        verdicts,
        points,
        cells,
        crossed,
        crossings.times_to_quality(crossed),
        comparisons.comparisons(crossed, pairs, spreads, results.config.same_within),
        by_axis.by_axis(results, verdicts, crossed, spreads),
        spreads,
        engine_pairs(results, images, known.pairs),
    )


def baseline_engine_of(results: Results) -> str:
    """The config's `baseline`, else numpy, else numba, else embree, else the alphabetically first engine."""
    return next(iter(engine_order(results)), "")


def _verdict(
    results: Results,
    contestant: Contestant,
    closed: Mapping[Group, list[Contestant]],
    engine: str,
    slope: Slope,
    images: Replicates,
    known: FromImages,
) -> Verdict:
    """Images are compared with those of the closed division, also those of the open one."""
    settings, done = contestant.settings, contestant.done
    ends = [cell.end for cell in done]
    nearest = nearest_of_engine(contestant, closed.get(group_of(contestant)._replace(division="closed"), ()), engine)
    image_baseline = None if nearest == contestant else nearest
    bias, radiance = _bias(results, contestant, images)
    bias = bias or known.bias.get(settings)
    equivalence = _equivalence(results, contestant, image_baseline, images) or known.baseline.get(settings)
    return Verdict(
        contestant,
        slope=slope,
        final_error=geometric_interval([point_error(end, results.metric)[0] for end in ends]),
        final_spp=geometric_interval([float(end.spp) for end in ends]),
        efficiency=efficiency([point_error(end, "mse")[0] for end in ends], [end.seconds for end in ends]),
        samples_per_second=geometric_interval([_rate(_samples(cell), cell.end) for cell in done]),
        rays_per_second=geometric_interval([_rate(end.rays, end) for end in ends]),
        phases={phase: geometric_interval([phase_seconds(cell, phase) for cell in done]) for phase in PHASES},
        image_baseline=image_baseline,
        bias=bias,
        radiance=radiance,
        equivalence=equivalence,
        flags=[
            *image_flags(results, contestant, bias, equivalence),
            *conduct_flags(contestant, bias),
            *["too_good_per_sample"] * (image_baseline is not None and _too_good(results, contestant, image_baseline)),
            *["contended"] * any(cell.machine.contended for cell in done),
            *["own_clock"] * any(map(reports_its_time, done)),
        ],
    )


def error_targets(results: Results) -> list[float]:
    """The targets as errors that fall (SSIM and PSNR turned round)."""
    return [as_error(results.metric, target) for target in results.targets]


def _bias(results: Results, contestant: Contestant, images: Replicates) -> tuple[BiasEstimate | None, RadianceSample | None]:
    """What the images differ from the reference by; None where either is missing, or of another size."""
    own, reference = images.of(contestant), images.reference(contestant)
    if not own or reference is None or next(iter(own.values())).shape != reference.mean.shape:
        return None, None
    stack = list(own.values())
    spp = pictured_spp(cell for cell in contestant.done if cell.block in own)
    return bias_estimate(stack, reference, results.epsilon, spp), radiance_sample(stack, reference, spp)


def _equivalence(
    results: Results, contestant: Contestant, baseline: Contestant | None, images: Replicates
) -> Equivalence | None:
    found = compared(baseline, contestant, images, shared_alpha(len(results.contestants))) if baseline else None
    return found.found if found else None


def reports_its_time(cell: Cell) -> bool:
    """Whether an external program's own report was the clock."""
    return bool(cell.counters.get("told_by_program"))


def _too_good(results: Results, contestant: Contestant, baseline: Contestant) -> bool:
    """Whether errors are lower than those of the baseline with the same sampler, at the most samples that both have.

    Of samplers whose samples depend on each other at the fewest: two sequences of one name are two sets of points, of which one
    may rightly have the lower error, but a single scrambled point is as good as any other.
    """
    both = (contestant, baseline)
    spp = shared_spp(*both)
    if contestant.settings.sampler != baseline.settings.sampler or not spp:
        return False
    independent = all(cell.smooth_sampler for each in both for cell in each.done)
    own, theirs = (_error_times_samples(results, each, max(spp) if independent else min(spp)) for each in both)
    return too_good_per_sample(own, theirs)


def _error_times_samples(results: Results, contestant: Contestant, spp: int) -> dict[int, float]:
    return {
        cell.block: point_error(point, results.metric)[0] * point.samples
        for cell in contestant.done
        for point in cell.points
        if point.spp == spp
    }


def _samples(cell: Cell) -> float:
    """Samples of the whole image at the last checkpoint."""
    return cell.end.samples * cell.width * cell.height


def _rate(amount: float | None, point: Point) -> float:
    return amount / point.seconds if amount and point.seconds > 0 else math.nan
