"""Slopes of error over samples, comparable within a scene."""

from __future__ import annotations

import numpy as np

from harness.statistics import Curve, Slope, common_samples, convergence_slope
from harness.store.records import Cell, Settings
from harness.store.results import Results, curve_of


def slopes(results: Results) -> dict[Settings, Slope]:
    """The slope of relMSE of every measured contestant, fitted over samples that the contestants of its scene share."""
    found: dict[Settings, Slope] = {}
    for scene in results.scenes:
        seeds = {c.settings: [_at_equal_samples(results, cell) for cell in c.done] for c in results.of_scene(scene)}
        samples = common_samples(list(seeds.values()))
        found |= {settings: convergence_slope(curves, samples) for settings, curves in seeds.items()}
    return found


def _at_equal_samples(results: Results, cell: Cell) -> Curve:
    """A cell's curve, its errors those of `spp` independent samples where the engine took more."""
    curve = curve_of(cell.points, results.relative_metric, cell.smooth_sampler, cell.reproducible)
    more = np.array([point.samples / point.spp for point in cell.points])
    return curve._replace(error=curve.error * more, se=curve.se * more)
