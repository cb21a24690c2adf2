"""How many samples a reference needs, so that its noise does not matter at a target."""

from __future__ import annotations

import math

from harness.metrics import Reference
from harness.statistics.convergence import CLEAR_ERRORS

SAMPLES_KNOWN = ("relmse", "mse")
"""Metrics for which `samples_needed` has a formula."""
TAILS = 16
"""How many times `samples_needed` a reference gets that decides by itself. Fireflies of an image lie where the reference is
noisy too, and the formula does not know them: on veach_plates, where it predicts a standard error of 6 % of the error, images
of one setting had 2 to 29 %."""


def samples_needed(pilot: Reference, target: float, epsilon: float | None) -> int:
    """About the samples per pixel from which on an error of `target` stands 10 standard errors above zero.

    The error is relMSE with `epsilon`, or MSE where that is None. `pilot` is any reference of the same image: its variance v
    falls as 1 / samples, so that k times its samples have v / k. The images that are judged are taken to have their error
    where the reference has its noise, e^2 = v target / <v / d>, and normal errors, alike in the channels of a pixel. Then
    se^2 = (12 / N^2) (A / k + B / k^2) + (C / k)^2 (see `metrics.reference_noise`), over N pixels times channels, with
    A = sum(v e^2 (1 + 3 e^2 R^2 / d^2) / d^2), B = sum(v^2 / d^2) and the shift C = <e^2 v (4 R^2 / d - 1) / d^2>, which MSE
    does not have. se = target / 10 is solved for k.
    """
    variance = pilot.variance
    denominator = 1.0 if epsilon is None else pilot.mean**2 + epsilon
    share = 0.0 if epsilon is None else pilot.mean**2 / denominator
    noise = float((variance / denominator).mean())
    if not noise > 0:
        return 1
    squared = variance * (target / noise)
    a = float((variance * squared * (1.0 + 3.0 * squared * share / denominator) / denominator**2).sum())
    b = float((variance**2 / denominator**2).sum())
    if epsilon is not None:
        shift = float((squared * variance * (4.0 * share - 1.0) / denominator**2).mean())
        b += (shift * variance.size) ** 2 / 12.0
    scale = (target * variance.size / CLEAR_ERRORS) ** 2 / 12.0
    return math.ceil(pilot.spp * (a + math.sqrt(a * a + 4.0 * scale * b)) / (2.0 * scale))
