"""z tests of estimates, over independent images that differ in their seeds, for any sampler."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engines.scene import Light, Material, Shape
from harness.verify.case import Array, Measurement, measurement
from harness.verify.scenes import path_tracer
from harness.verify.subject import Subject
from harness.verify.tolerances import LARGEST_Z, ROUNDING

REPLICATES = 32
STRATEGIES = ("light", "bsdf", "mis")
LARGEST_ERROR = 2e-3
"""A test with a larger standard error would find no bias, and fails."""


def means(
    subject: Subject,
    shapes: Sequence[Shape],
    materials: Sequence[Material],
    lights: Sequence[Light],
    view: Any,
    shader: Any,
    spp: int = 1,
    power: int = 1,
    **settings: Any,
) -> Array:
    """(REPLICATES,) means of an image to a power; the images differ in their seeds only."""
    images = (subject.image(shapes, materials, lights, view, shader, spp, seed=1 + k, **settings) for k in range(REPLICATES))
    return np.array([float(np.mean(image**power)) for image in images])


def by_strategy(
    subject: Subject,
    shapes: Sequence[Shape],
    materials: Sequence[Material],
    lights: Sequence[Light],
    view: Any,
    truth: float,
    name: str,
    spp: int = 1,
    strategies: Sequence[str] = STRATEGIES,
    max_depth: int = 2,
    **options: Any,
) -> Iterator[Measurement]:
    """The z score of the path tracer's mean image, by each way to sample direct light; `options` are the shader's."""
    for direct in strategies:
        shader = {**path_tracer(max_depth, direct), **options}
        replicates = means(subject, shapes, materials, lights, view, shader, spp)
        yield z_score(subject, replicates, truth, f"{name}, {direct}")


def z_score(subject: Subject, replicates: Array, truth: float, parameter: str, largest: float = LARGEST_ERROR) -> Measurement:
    """|mean - truth| in standard errors; infinite where the standard error is above `largest`.

    The standard error is at least as large as the rounding error of an image without noise.
    """
    rounding = ROUNDING[subject.tracing] / LARGEST_Z * abs(truth)
    error = max(float(replicates.std(ddof=1)) / math.sqrt(replicates.size), rounding)
    z = (replicates.mean() - truth) / error if error < largest else math.inf
    return measurement(z, parameter, note=f"{replicates.mean():.6f} against {truth:.6f}, standard error {error:.1e}")
