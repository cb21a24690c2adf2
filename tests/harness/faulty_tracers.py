"""Engines whose answers to rays are wrong in known places; named as `faulty_tracers:Drops`."""

from __future__ import annotations

import numpy as np

import engines
from engines.interface import Hits

EVERY = 10
"""Every so many answers of a call are wrong, from the first on."""


class Faulty:
    """numpy's answers, changed by `spoilt`."""

    version = "1"

    def why_not(self, scene, settings):
        return engines.engine("numpy").why_not(scene, settings)

    def accelerators(self):
        return engines.engine("numpy").accelerators()

    def prepare(self, scene, settings):
        renderer = engines.engine("numpy").prepare(scene, settings)
        trace, occluded = renderer.trace, renderer.occluded
        renderer.trace = lambda *rays: self.spoilt(trace(*rays), scene)
        renderer.occluded = lambda *rays: self.darkened(occluded(*rays))
        return renderer

    def spoilt(self, hits: Hits, scene) -> Hits:
        return hits

    def darkened(self, blocked):
        return blocked


class Drops(Faulty):
    """Loses hits."""

    name = "drops"

    def spoilt(self, hits, scene):
        for array, nothing in ((hits.t, np.inf), (hits.shape, -1), (hits.primitive, -1)):
            array[::EVERY] = nothing
        return hits

    def darkened(self, blocked):
        blocked[::EVERY] = False
        return blocked


class Misnames(Faulty):
    """Names a shape that is somewhere else, at the right distance."""

    name = "misnames"

    def spoilt(self, hits, scene):
        hits.shape[::EVERY] = np.where(hits.shape[::EVERY] < 0, -1, (hits.shape[::EVERY] + 1) % len(scene.shapes))
        hits.primitive[::EVERY] = np.minimum(hits.primitive[::EVERY], 0)
        return hits

    def darkened(self, blocked):
        blocked[::EVERY] = True
        return blocked


class Crashes(Faulty):
    """Cannot trace."""

    name = "crashes"

    def spoilt(self, hits, scene):
        raise ValueError("no such ray")


class Short(Faulty):
    """Answers all rays but one."""

    name = "short"

    def spoilt(self, hits, scene):
        return Hits(*(getattr(hits, name)[1:] for name in Hits.__slots__))
