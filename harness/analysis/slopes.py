"""Slopes of error over samples, comparable within a scene."""

from __future__ import annotations

from harness.statistics import Slope, common_samples, convergence_slope
from harness.store.results import Results, Settings


def slopes(results: Results) -> dict[Settings, Slope]:
    """The slope of relMSE of every measured contestant, fitted over samples that the contestants of its scene share."""
    found: dict[Settings, Slope] = {}
    for scene in results.scenes:
        seeds = {c.settings: [results.curve(cell, results.relative_metric) for cell in c.done] for c in results.of_scene(scene)}
        samples = common_samples(list(seeds.values()))
        found |= {settings: convergence_slope(curves, samples) for settings, curves in seeds.items()}
    return found
