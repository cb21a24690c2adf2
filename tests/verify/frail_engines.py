"""Engines that fail: one whose rays all miss, and one whose process dies."""

import os
import signal
from dataclasses import dataclass

import numpy as np

import engines


@dataclass
class Misser:
    """All its rays miss; it declines to render glass, and has no `occluded`."""

    name: str = "misser"
    version: str = "0"

    def accelerators(self):
        return {"auto": {}}

    def why_not(self, scene, settings):
        glass = any(material.fresnel for material in scene.materials)
        return "no glass" if glass else None if settings.precision == "float64" else "float64 only"

    def prepare(self, scene, settings):
        return self

    def trace(self, origins, directions, t_max=np.inf):
        n = len(origins)
        none = np.full(n, -1)
        return engines.Hits(np.full(n, np.inf), none, none, np.zeros((n, 3)), np.zeros(n), np.zeros(n))


class Dying(Misser):
    """Its process is killed by scenes of two shapes."""

    def prepare(self, scene, settings):
        if len(scene.shapes) == 2:
            os.kill(os.getpid(), signal.SIGSEGV)
        return self
