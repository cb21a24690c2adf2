"""Does an engine converge to the reference, and is it what it says it is? Bias over pairs of seeds, sanity flags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.metrics import Reference, standard_error
from harness.statistics.convergence import NOISE_ERRORS
from harness.statistics.intervals import mean_interval

Image = NDArray[np.float64]


class BiasEstimate(NamedTuple):
    """`squared`: relative squared bias and its standard error (may be negative); `biased`: over 3 se above zero."""

    squared: float
    se: float
    pairs: int

    @property
    def biased(self) -> bool:
        return self.squared > NOISE_ERRORS * self.se

    @property
    def root(self) -> float:
        """The bias relative to the radiance, 0 where the estimate is negative."""
        return math.sqrt(max(self.squared, 0.0))


def bias_estimate(images: Sequence[Image], reference: Reference, epsilon: float) -> BiasEstimate:
    """mean((A-R1)(B-R2) / (R^2+eps)) over all ordered pairs of different seeds A, B; needs two images.

    Renders and reference halves are independent of each other, so all noise cancels in expectation. The sum over
    pairs is (sum(A)-kR1)(sum(A)-kR2) - sum((A-R1)(A-R2)), over k(k-1). The standard error comes from interleaved
    groups of pixels. False alarms: 0.2 % (one-sided, 3 se).
    """
    k = len(images)
    if k < 2:
        return BiasEstimate(math.nan, math.nan, 0)
    total = np.zeros_like(reference.mean)
    own = np.zeros_like(reference.mean)
    for image in images:
        total += image
        own += (image - reference.half_1) * (image - reference.half_2)
    products = ((total - k * reference.half_1) * (total - k * reference.half_2) - own) / (k * (k - 1))
    products /= reference.mean**2 + epsilon
    return BiasEstimate(float(products.mean()), standard_error(products), k * (k - 1) // 2)


def on_bias_floor(bias: BiasEstimate, corrected_error: float) -> bool:
    """Whether a significant bias makes up half or more of the error that is left: more samples will hardly help."""
    return bias.biased and bias.squared >= 0.5 * corrected_error


def too_good_per_sample(error_times_spp: Mapping[int, float], baseline: Mapping[int, float], margin: float = 1.1,
                        level: float = 0.99) -> bool:  # fmt: skip
    """Whether error x samples is below the baseline estimator's by more than `margin`, by a 99 % interval over seeds.

    Both map seed (or block) to error x spp at the same spp and with the same sampler and shader. An engine that needs
    fewer samples than the estimator it claims to run has another estimator, clamps, or denoises.
    """
    common = [key for key in baseline if key in error_times_spp]
    pairs = [(baseline[key], error_times_spp[key]) for key in common]
    # A difference of logarithms: the quotient of finite numbers may be zero or infinite.
    logs = [math.log(base) - math.log(other) for base, other in pairs if 0 < base < math.inf and 0 < other < math.inf]
    return bool(mean_interval(logs, level).low > math.log(margin))
