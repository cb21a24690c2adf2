"""What the results say: every contestant's verdict, computed once for the tables, the plots and the report."""

from __future__ import annotations

import math
from collections.abc import Mapping

from harness.analysis import archived_verdicts
from harness.analysis.baselines import baseline_of, engine_order, nearest_of_engine
from harness.analysis.conduct import conduct_flags
from harness.analysis.equivalence import Replicates, compared, engine_pairs, pictured_spp, shared_spp
from harness.analysis.image_flags import image_flags
from harness.analysis.model import Analysis, Group, Verdict, raced_together
from harness.analysis.races import run_races
from harness.analysis.slopes import slopes
from harness.metrics import as_error
from harness.statistics import Slope, bias_estimate, efficiency, geometric_interval, time_to_quality, too_good_per_sample
from harness.statistics.bias import radiance_sample
from harness.statistics.equivalence import shared_alpha
from harness.store.records import Cell, Point
from harness.store.results import Contestant, Results, fixed_seconds, phase_seconds, point_error


def analyse(results: Results) -> Analysis:
    """Draws all conclusions; reads the last image of every cell for bias and equivalence."""
    slope_of = slopes(results)
    verdicts = [_own_verdict(results, c, slope_of[c.settings]) for c in results.contestants if c.done]
    images, known = Replicates(results), archived_verdicts.read_archived(results)
    engine = baseline_engine_of(results)
    groups = {key: [v.contestant for v in group] for key, group in raced_together(verdicts).items()}
    for verdict in sorted(verdicts, key=lambda v: (v.contestant.settings.scene, v.contestant.settings.shader)):
        group = next(group for group in groups.values() if verdict.contestant in group)
        found = baseline_of(verdict.contestant, group, results)
        if found is not None:
            verdict.against, verdict.factors = found
        _compare(results, verdict, nearest_of_engine(verdict.contestant, _closed_beside(verdict, groups), engine), images)
        verdict.bias = verdict.bias or known.bias.get(verdict.contestant.settings)
        verdict.equivalence = verdict.equivalence or known.baseline.get(verdict.contestant.settings)
        verdict.flags = _flags(results, verdict)
    analysis = Analysis(results, verdicts, engine, pairs=engine_pairs(results, images, known.pairs))
    run_races(analysis)
    return analysis


def _closed_beside(verdict: Verdict, groups: Mapping[Group, list[Contestant]]) -> list[Contestant]:
    """Contestants of the closed division, whose images those of both are compared with."""
    s = verdict.contestant.settings
    return groups.get((s.scene, verdict.contestant.race, s.size, "closed", s.machine), [])


def baseline_engine_of(results: Results) -> str:
    """The config's `baseline`, else numpy, else numba, else embree, else the alphabetically first engine."""
    return next(iter(engine_order(results)), "")


def _own_verdict(results: Results, contestant: Contestant, slope: Slope) -> Verdict:
    """What needs no other contestant and no image."""
    curves = [results.curve(cell) for cell in contestant.runs]
    fixed = [fixed_seconds(cell) for cell in contestant.runs]
    done = contestant.done
    ends = [cell.end for cell in done]
    return Verdict(
        contestant,
        warm=[time_to_quality(curves, [0.0] * len(curves), target) for target in error_targets(results)],
        cold=[time_to_quality(curves, fixed, target) for target in error_targets(results)],
        slope=slope,
        final_error=geometric_interval([point_error(end, results.metric)[0] for end in ends]),
        final_spp=geometric_interval([float(end.spp) for end in ends]),
        efficiency=efficiency([point_error(end, "mse")[0] for end in ends], [end.seconds for end in ends]),
        samples_per_second=geometric_interval([_rate(_samples(cell), cell.end) for cell in done]),
        rays_per_second=geometric_interval([_rate(end.rays, end) for end in ends]),
        phases={
            phase: geometric_interval([phase_seconds(cell, phase) for cell in done])
            for phase in ("import", "load", "build", "compile", "render")
        },
        quality_speedups=[None] * len(results.targets),
        possible_winner=[False] * len(results.targets),
    )


def error_targets(results: Results) -> list[float]:
    """The targets as errors that fall (SSIM and PSNR turned round)."""
    return [as_error(results.metric, target) for target in results.targets]


def _compare(results: Results, verdict: Verdict, baseline: Contestant | None, images: Replicates) -> None:
    """Fills in what needs the reference or the images."""
    contestant = verdict.contestant
    own_images, reference = images.of(contestant), images.reference(contestant)
    if own_images and reference is not None and next(iter(own_images.values())).shape == reference.mean.shape:
        spp = pictured_spp(cell for cell in contestant.done if cell.block in own_images)
        verdict.bias = bias_estimate(list(own_images.values()), reference, results.epsilon, spp)
        verdict.radiance = radiance_sample(list(own_images.values()), reference, spp)
    if baseline is not None and baseline is not contestant:
        verdict.baseline = baseline
        comparison = compared(baseline, contestant, images, shared_alpha(len(results.contestants)))
        verdict.equivalence = comparison.found if comparison else None


def _flags(results: Results, verdict: Verdict) -> list[str]:
    flags = image_flags(results, verdict) + conduct_flags(verdict.contestant, verdict.bias)
    if verdict.baseline is not None and _too_good(results, verdict.contestant, verdict.baseline):
        flags.append("too_good_per_sample")
    if any(cell.machine.contended for cell in verdict.contestant.done):
        flags.append("contended")
    if any(reports_its_time(cell) for cell in verdict.contestant.done):
        flags.append("own_clock")
    return flags


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
