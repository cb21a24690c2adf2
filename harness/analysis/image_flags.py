"""Flags that a contestant's images earn: bias against the reference, another image than the baseline's, bad samples."""

from __future__ import annotations

import numpy as np

from harness.statistics import BiasEstimate, Equivalence, on_bias_floor
from harness.store.results import Contestant, Results, point_error


def image_flags(
    results: Results, contestant: Contestant, bias: BiasEstimate | None, equivalence: Equivalence | None
) -> list[str]:
    """The names, of `analysis.model.FLAGS`, of what is wrong with the images of a contestant."""
    flags = []
    if bias is not None:
        flags += bias.flags
        left = [point_error(cell.end, results.relative_metric)[0] for cell in contestant.done]
        if np.isfinite(left).all() and on_bias_floor(bias, float(np.mean(left))):
            flags.append("on_bias_floor")
    if equivalence is not None and not equivalence.passed:
        flags.append("other_image" if equivalence.verdict == "different" else "equivalence_unresolved")
    return flags + bad_sample_flags(contestant)


def bad_sample_flags(contestant: Contestant) -> list[str]:
    """`nonfinite_pixels` for an image with NaN or infinity in any cell, `bad_samples` where samples were, which films count
    as black."""
    pixels = any(point.metrics.get("nonfinite") for cell in contestant.cells for point in cell.points)
    samples = any(cell.counters.get("bad_samples") for cell in contestant.cells)
    return ["nonfinite_pixels"] * pixels + ["bad_samples"] * samples
