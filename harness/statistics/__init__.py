"""Estimators that the verdicts rest on: pure functions of arrays, each with its formula, its source and an interval.

intervals    means and geometric means with Student's t, proportions
convergence  error curves, their slopes over the samples that a scene's contestants share
crossings    where an error curve reaches a target
quality      censored time-to-quality, efficiency
ratios       ratios of times, verdicts and possible winners of a race, the persistent spread of A/A twins
sessions     what changed between two sides of one or more sessions
scaling      speed-up over threads, Amdahl's serial fraction
fronts       Pareto front of intervals, ECDF of targets reached
bias         bias over pairs of seeds, sanity flags
equivalence  two engines at three scales, with a positive verdict
calibration  how often these rules err on synthetic contestants made of a run's own noise
"""

from harness.statistics.bias import BiasEstimate, bias_estimate, on_bias_floor, too_good_per_sample
from harness.statistics.convergence import Curve, Slope, common_samples, convergence_slope, curve
from harness.statistics.crossings import Bound, Crossing, Reading, find_crossing
from harness.statistics.equivalence import Equivalence, equivalence
from harness.statistics.fronts import ecdf, pareto_front
from harness.statistics.intervals import Estimate, bounded_interval, geometric_interval, mean_interval, proportion_interval
from harness.statistics.quality import QualityTime, crossing_seconds, efficiency, reading_of, time_to_quality
from harness.statistics.ratios import (
    NO_SPREAD,
    UNKNOWN_SPREAD,
    PersistentSpread,
    Race,
    Ratio,
    TwinPair,
    persistent_spread,
    race,
    twin_pairs,
)
from harness.statistics.scaling import ParallelRow, amdahl_fit, parallel_speedups
from harness.statistics.sessions import Change, change_of_errors, change_of_times, judge_changes
