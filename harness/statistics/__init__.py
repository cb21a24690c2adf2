"""Estimators that the verdicts rest on: pure functions of arrays, each with its formula, its source and an interval.

    intervals    median with bootstrap, mean with Student's t
    convergence  log-log slope, monotone fit, first crossing of a target
    quality      censored time-to-quality, efficiency
    comparison   paired speed-ups between configurations, the noise floor of an A/A twin
    scaling      speed-up over threads, Amdahl's serial fraction
    fronts       Pareto front of intervals, ECDF of targets reached
    bias         bias over pairs of seeds, sanity flags
    equivalence  two engines at three scales, with a positive verdict
"""

from harness.statistics.bias import BiasEstimate, bias_estimate, on_bias_floor, too_good_per_sample
from harness.statistics.comparison import Speedup, noise_floor, paired_speedup, unpaired_ratio
from harness.statistics.convergence import Crossing, Slope, convergence_slope, first_crossing, monotone_fit
from harness.statistics.equivalence import Equivalence, equivalence
from harness.statistics.fronts import ecdf, pareto_front
from harness.statistics.intervals import Estimate, mean_interval, median_interval
from harness.statistics.quality import QualityTime, efficiency, reliable_errors, time_to_quality
from harness.statistics.scaling import ParallelRow, amdahl_fit, parallel_speedups

__all__ = [
    "BiasEstimate",
    "Crossing",
    "Equivalence",
    "Estimate",
    "ParallelRow",
    "QualityTime",
    "Slope",
    "Speedup",
    "amdahl_fit",
    "bias_estimate",
    "convergence_slope",
    "ecdf",
    "efficiency",
    "equivalence",
    "first_crossing",
    "mean_interval",
    "median_interval",
    "monotone_fit",
    "noise_floor",
    "on_bias_floor",
    "paired_speedup",
    "parallel_speedups",
    "pareto_front",
    "reliable_errors",
    "time_to_quality",
    "too_good_per_sample",
    "unpaired_ratio",
]
