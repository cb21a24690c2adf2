"""Bounds of counts for tests by simulation: what passes a bound by chance alone does so once in 200,000 draws.

`rate` is the true rate of the method under test, or an upper (`at_least`: lower) bound of it. The tests state it; it was found
with 10,000 trials of other seeds.
"""

from scipy import stats

LEVEL = 5e-6


def at_most(rate: float, trials: int) -> float:
    """The largest share of `trials` that is still believed of events of this rate."""
    return float(stats.binom.isf(LEVEL, trials, rate)) / trials


def at_least(rate: float, trials: int) -> float:
    """The smallest share of `trials` that is still believed of events of this rate."""
    return 1.0 - at_most(1.0 - rate, trials)
