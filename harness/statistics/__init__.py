"""Estimators that the verdicts rest on: pure functions of arrays, each with its formula, its source and an interval.

    intervals    median with bootstrap, mean with Student's t
    convergence  error curves, their slopes over the samples that a scene's contestants share
    crossings    where an error curve reaches a target
    quality      censored time-to-quality, efficiency
    comparison   paired speed-ups between configurations, the noise floor of an A/A twin
    scaling      speed-up over threads, Amdahl's serial fraction
    fronts       Pareto front of intervals, ECDF of targets reached
    bias         bias over pairs of seeds, sanity flags
    equivalence  two engines at three scales, with a positive verdict
"""

from harness.statistics.bias import BiasEstimate, bias_estimate, on_bias_floor, too_good_per_sample
from harness.statistics.comparison import Speedup, noise_floor, paired_speedup, unpaired_ratio
from harness.statistics.convergence import Curve, Slope, common_samples, convergence_slope, curve
from harness.statistics.crossings import Bound, Crossing, Reading, find_crossing
from harness.statistics.equivalence import Equivalence, equivalence
from harness.statistics.fronts import ecdf, pareto_front
from harness.statistics.intervals import Estimate, mean_interval, median_interval
from harness.statistics.quality import QualityTime, crossing_seconds, efficiency, reading_of, time_to_quality
from harness.statistics.scaling import ParallelRow, amdahl_fit, parallel_speedups

__all__ = [
    "BiasEstimate",
    "Bound",
    "Crossing",
    "Curve",
    "Equivalence",
    "Estimate",
    "ParallelRow",
    "QualityTime",
    "Reading",
    "Slope",
    "Speedup",
    "amdahl_fit",
    "bias_estimate",
    "common_samples",
    "convergence_slope",
    "crossing_seconds",
    "curve",
    "ecdf",
    "efficiency",
    "equivalence",
    "find_crossing",
    "mean_interval",
    "median_interval",
    "noise_floor",
    "on_bias_floor",
    "paired_speedup",
    "parallel_speedups",
    "pareto_front",
    "reading_of",
    "time_to_quality",
    "too_good_per_sample",
    "unpaired_ratio",
]
