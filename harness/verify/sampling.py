"""Samplers, seen through images: their means are right, and their errors fall as fast as theirs should."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from harness.verify import closed_forms as forms
from harness.verify.case import Array, Measured, Section, measured
from harness.verify.stage import FLOOR, material, path_tracer, point_view, scene, sphere
from harness.verify.subject import Subject

SECTION = Section("sampling")
SLOPES = {"random": -0.5, "stratified": -1.0, "halton": -0.85, "sobol": -1.0}
"""The least that each must reach. Sobol's -1.6 belongs to its first two dimensions; lights draw from the third on."""
CHECKPOINTS = (4, 16, 64)
RADIUS, DISTANCE = 1.0, 2.0
TRUTH = 0.9 / math.pi * forms.sphere(RADIUS, DISTANCE, math.pi / 6)


def _errors(subject: Subject, sampler: str, seed: int) -> list[Array]:
    """Errors of 256 replicates of one point at each checkpoint: a smooth integrand of two dimensions."""
    angle = math.pi / 6
    lamp = sphere((DISTANCE * math.sin(angle), DISTANCE * math.cos(angle), 0.0), RADIUS, 1)
    held = scene([FLOOR, lamp], [material(kd=0.9), material(emission=1)], [], point_view((-4, 1.5, 1), (0, 0, 0), 16))
    errors = []
    for spp in CHECKPOINTS:
        chosen = {"name": sampler, "strata": spp} if sampler == "stratified" else sampler
        renderer = subject.prepared(held, shader=path_tracer(2, "light"), sampler=chosen, seed=seed)
        errors.append(renderer.render(spp).mean()[:, :, 0].ravel() - TRUTH)
    return errors


@SECTION.case("q.mean", "Every sampler has the mean of the integral.", "raybench")
def means(subject: Subject) -> Iterator[Measured]:
    for sampler in SLOPES:
        last = np.concatenate([_errors(subject, sampler, seed)[-1] for seed in range(2)])
        rounding = (1e-12 if subject.tracing == "float64" else 2e-6) * TRUTH
        error = max(float(last.std(ddof=1)) / math.sqrt(last.size), rounding)
        yield measured(last.mean() / error, sampler, note=f"standard error {error:.1e}")


@SECTION.case("q.slope", "The error of a smooth integral falls with the samples at least as fast as the sampler's should.",
              "Owen 1997")  # fmt: skip
def slopes(subject: Subject) -> Iterator[Measured]:
    """Slope of log RMSE over log samples, 4 to 64, over 256 pixels and two seeds."""
    for sampler, expected in SLOPES.items():
        runs = [_errors(subject, sampler, seed) for seed in range(2)]
        rmse = [math.sqrt(float(np.mean(np.concatenate(part) ** 2))) for part in zip(*runs, strict=True)]
        slope = float(np.polyfit(np.log(CHECKPOINTS), np.log(rmse), 1)[0])
        excess = abs(slope - expected) if sampler == "random" else max(slope - expected, 0.0)
        yield measured(excess, sampler, note=f"slope {slope:.3f}, wanted {expected}")
