"""Engines that fail: whose rays all miss, whose process dies, sooner or later; and such as lack almost everything."""

import atexit
import os
import signal
from dataclasses import dataclass, replace

import numpy as np

import engines
from engines.scene import Diffuse


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


class Unwilling(Misser):
    """It renders nothing at all."""

    def why_not(self, scene, settings):
        return "today is Sunday"


class Dead(Misser):
    """Its process is killed when it is loaded."""

    def __init__(self):
        os.kill(os.getpid(), signal.SIGSEGV)


class Narrow:
    """The reference engine without Sobol: it draws at random alone, or by a sampler of its own, which is called `white`."""

    name, version, known = "narrow", "1", ("random",)

    def __init__(self):
        self.inner = engines.engine("numpy")

    def accelerators(self):
        return self.inner.accelerators()

    def _settings(self, settings):
        own = settings.sampler == "white"
        return replace(settings, sampler="random") if own else settings

    def why_not(self, scene, settings):
        name = settings.sampler["name"] if isinstance(settings.sampler, dict) else settings.sampler
        if name not in self.known:
            return f"it has no sampler {name}"
        return self.inner.why_not(scene, self._settings(settings))

    def prepare(self, scene, settings):
        return self.inner.prepare(scene, self._settings(settings))


class Matt(Narrow):
    """Besides kd, ks and kt it has no model but `Diffuse`."""

    name, known = "matt", ("random", "constant")

    def why_not(self, scene, settings):
        others = [m for m in scene.materials if not isinstance(m.bsdf, Diffuse | None)]
        return "it is matt" if others else super().why_not(scene, settings)


class Own(Narrow):
    """It has its own sampler alone."""

    name, known = "own", ("white",)

    def samplers(self):
        return {"white": {}}


class Flat(Narrow):
    """It has the shader `albedo` alone."""

    name = "flat"

    def why_not(self, scene, settings):
        return super().why_not(scene, settings) if settings.shader == "albedo" else "it shows albedo alone"


class LateToCrash(Narrow):
    """Its process crashes when it ends, as it does with two native libraries that share a third one."""

    name = "late"

    def __init__(self):
        super().__init__()
        atexit.register(os.kill, os.getpid(), signal.SIGSEGV)


class CrashingRenders(Narrow):
    """Its process crashes when it renders."""

    name = "crashing"

    def prepare(self, scene, settings):
        os.kill(os.getpid(), signal.SIGSEGV)
