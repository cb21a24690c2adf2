"""Flags that a contender's images earn: bias against the reference, another image than the baseline's, bad samples."""

from __future__ import annotations

from harness.analysis.model import Verdict
from harness.statistics import mean_interval, on_bias_floor
from harness.store.results import Contender, Results, point_error


def image_flags(results: Results, verdict: Verdict) -> list[str]:
    """The names, of `analysis.model.FLAGS`, of what is wrong with the images of a contender."""
    flags = []
    if verdict.bias is not None:
        flags += verdict.bias.flags
        left = [point_error(cell["points"][-1], results.relative_metric)[0] for cell in verdict.contender.done]
        if on_bias_floor(verdict.bias, mean_interval(left).value):
            flags.append("on_bias_floor")
    if verdict.equivalence is not None and verdict.equivalence.verdict == "different":
        flags.append("other_image")
    return flags + bad_sample_flags(verdict.contender)


def bad_sample_flags(contender: Contender) -> list[str]:
    """`nonfinite_pixels` for an image with NaN or infinity in any cell, `bad_samples` where samples were, which films count
    as black."""
    points = [point for cell in contender.cells for point in cell.get("points") or []]
    pixels = any((point.get("metrics") or {}).get("nonfinite") for point in points)
    samples = any((cell.get("counters") or {}).get("bad_samples") for cell in contender.cells)
    return ["nonfinite_pixels"] * pixels + ["bad_samples"] * samples
