"""What the results say: every contender's verdict, computed once for the tables, the plots and the report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from harness.analysis import archived_verdicts
from harness.analysis.equivalence import Replicates, common_spp, compared, engine_pairs, similarity
from harness.analysis.model import Analysis, Verdict, seconds_per_sample
from harness.config.experiment import PREFERRED_BASELINES
from harness.metrics import as_error
from harness.statistics import (
    bias_estimate,
    convergence_slope,
    efficiency,
    median_interval,
    noise_floor,
    on_bias_floor,
    paired_speedup,
    time_to_quality,
    too_good_per_sample,
)
from harness.statistics.equivalence import shared_alpha
from harness.store.results import Contender, Event, Results, phase_seconds, point_error


def analyse(results: Results) -> Analysis:
    """Draws all conclusions; reads the last image of every cell for bias and equivalence."""
    baseline_engine = baseline_engine_of(results)
    floors = noise_floors(results)
    verdicts = [_own_verdict(results, contender) for contender in results.contenders if contender.done]
    images, known = Replicates(results), archived_verdicts.read_archived(results)
    for verdict in sorted(verdicts, key=lambda v: (v.contender.settings.scene, v.contender.settings.shader)):
        _compare(results, verdict, baseline_engine, floors, images)
        verdict.bias = verdict.bias or known.bias.get(verdict.contender.settings)
        verdict.equivalence = verdict.equivalence or known.baseline.get(verdict.contender.settings)
        verdict.flags = _flags(results, verdict)
    return Analysis(results, verdicts, floors, baseline_engine, engine_pairs(results, images, known.pairs))


def baseline_engine_of(results: Results) -> str:
    """The config's `baseline`, else numpy, else numba, else embree, else the alphabetically first engine."""
    engines = [c.settings.engine for c in results.contenders if c.done]
    wished = (results.manifest.get("config") or {}).get("baseline")
    for name in (wished, *PREFERRED_BASELINES, *sorted(engines)):
        if name in engines:
            return str(name)
    return ""


def noise_floors(results: Results) -> dict[str, float]:
    """Scene -> the largest noise floor among contenders that differ in their label alone."""
    floors: dict[str, float] = {}
    unlabelled = {c.settings._replace(label=""): c for c in reversed(results.contenders) if c.done}
    for contender in results.contenders:
        twin = unlabelled.get(contender.settings._replace(label=""))
        if contender.done and twin is not None and twin is not contender:
            floor = noise_floor(seconds_per_sample(twin), seconds_per_sample(contender))
            if not math.isnan(floor):
                floors[contender.settings.scene] = max(floor, floors.get(contender.settings.scene, 0.0))
    return floors


def baseline_for(contender: Contender, results: Results, engine: str) -> Contender | None:
    """The baseline engine's contender on the same scene, shader and size that shares the most other settings."""
    own = contender.settings
    same = [c for c in results.of_scene(own.scene) if c.settings.engine == engine and c.settings.shader == own.shader
            and c.settings.size == own.size and c.settings.machine == own.machine]  # fmt: skip
    return max(same, key=partial(similarity, contender), default=None)


def _own_verdict(results: Results, contender: Contender) -> Verdict:
    """What needs no other contender and no image."""
    curves = [results.curve(cell) for cell in contender.runs]
    fixed = [contender.fixed_seconds(cell) for cell in contender.runs]
    done = contender.done
    ends = [cell["points"][-1] for cell in done]
    seconds = [float(end["seconds"]) for end in ends]
    return Verdict(
        contender,
        warm=[time_to_quality(curves, [0.0] * len(curves), target) for target in error_targets(results)],
        cold=[time_to_quality(curves, fixed, target) for target in error_targets(results)],
        slope=convergence_slope([results.curve(cell, "spp", results.relative_metric) for cell in done]),
        final_error=median_interval([point_error(end, results.metric)[0] for end in ends]),
        final_spp=median_interval([float(end["spp"]) for end in ends]),
        efficiency=efficiency([_mse(end) for end in ends], seconds),
        samples_per_second=median_interval([_rate(_samples(cell), cell["points"][-1]) for cell in done]),
        rays_per_second=median_interval([_rate(end.get("rays"), end) for end in ends]),
        phases={phase: median_interval([phase_seconds(cell, phase) for cell in done])
                for phase in ("import", "load", "build", "compile", "render")},
    )  # fmt: skip


def error_targets(results: Results) -> list[float]:
    """The targets as errors that fall (SSIM and PSNR turned round)."""
    return [as_error(results.metric, target) for target in results.targets]


def _compare(results: Results, verdict: Verdict, engine: str, floors: Mapping[str, float], images: Replicates) -> None:
    """Fills in what needs the baseline, the reference or the images."""
    contender = verdict.contender
    baseline = baseline_for(contender, results, engine)
    own_images = list(images.of(contender).values())
    reference = results.reference(contender.done[0].get("reference_id"))
    if own_images and reference is not None and own_images[0].shape == reference.mean.shape:
        verdict.bias = bias_estimate(own_images, reference, results.epsilon)
    if baseline is not None and baseline is not contender:
        verdict.baseline = baseline
        floor = floors.get(contender.settings.scene, 0.0)
        verdict.speedup = paired_speedup(seconds_per_sample(baseline), seconds_per_sample(contender), floor)
        verdict.quality_speedups = [
            paired_speedup(_by_block(results, baseline, target), _by_block(results, contender, target), floor)
            for target in error_targets(results)
        ]
        comparison = compared(baseline, contender, images, shared_alpha(len(results.contenders)))
        verdict.equivalence = comparison.found if comparison else None


def _by_block(results: Results, contender: Contender, target: float) -> dict[int, float]:
    """Block -> warm seconds until `target`, inf where it was not reached."""
    runs = contender.runs
    quality = time_to_quality([results.curve(cell) for cell in runs], [0.0] * len(runs), target)
    return {cell["block"]: seconds for cell, seconds in zip(runs, quality.crossings, strict=True)}


def _flags(results: Results, verdict: Verdict) -> list[str]:
    flags = []
    if verdict.bias is not None and verdict.bias.biased:
        flags.append("biased")
        left = [point_error(cell["points"][-1], results.relative_metric)[0] for cell in verdict.contender.done]
        if on_bias_floor(verdict.bias, median_interval(left).value):
            flags.append("on_bias_floor")
    if verdict.equivalence is not None and verdict.equivalence.verdict == "different":
        flags.append("other_image")
    if verdict.baseline is not None and verdict.baseline.settings.sampler == verdict.contender.settings.sampler:
        spp = common_spp(verdict.contender, verdict.baseline)
        own, theirs = (_error_times_spp(results, c, spp) for c in (verdict.contender, verdict.baseline))
        if too_good_per_sample(own, theirs):
            flags.append("too_good_per_sample")
    points = [point for cell in verdict.contender.cells for point in cell.get("points") or []]
    if any((point.get("metrics") or {}).get("nonfinite") for point in points):
        flags.append("nonfinite_pixels")
    if any((cell.get("counters") or {}).get("bad_samples") for cell in verdict.contender.cells):
        flags.append("bad_samples")
    if any((cell.get("machine") or {}).get("contended") for cell in verdict.contender.done):
        flags.append("contended")
    if any(reports_its_time(cell) for cell in verdict.contender.done):
        flags.append("own_clock")
    return flags


def reports_its_time(cell: Event) -> bool:
    """Whether an external program's own report was the clock."""
    return bool((cell.get("counters") or {}).get("told_by_program"))


def _error_times_spp(results: Results, contender: Contender, spp: int | None) -> dict[int, float]:
    return {cell["block"]: point_error(point, results.metric)[0] * point["spp"]
            for cell in contender.done for point in cell["points"] if point["spp"] == spp}  # fmt: skip


def _mse(point: Event) -> float:
    metrics = point.get("metrics") or {}
    value = metrics.get("mse_corrected", metrics.get("mse"))
    return math.nan if value is None else float(value)


def _samples(cell: Event) -> float:
    """Samples of the whole image at the last checkpoint."""
    return float(cell["points"][-1]["spp"]) * (cell.get("width") or 0) * (cell.get("height") or 0)


def _rate(amount: float | None, point: Event) -> float:
    return float(amount) / float(point["seconds"]) if amount and point["seconds"] > 0 else math.nan
