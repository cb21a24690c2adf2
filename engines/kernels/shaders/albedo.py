"""The first of kd, ks, kt and emission that is not black, as MobileRT's shader of the diffuse material shows it."""

from __future__ import annotations

from engines.kernels.jit import const, inline
from engines.kernels.shaders.step import finish
from engines.kernels.vector import Vec3, largest, select3

EVERY_LIGHT = False
BRANCHES = False


@inline
def step(hit, material, light, draws, path, options, needs):
    zero = const(0.0, hit.t)
    none = Vec3(zero, zero, zero)
    shown = select3(hit.miss, none, material.emission)
    shown = select3(largest(material.kt) > zero, material.kt, shown)
    shown = select3(largest(material.ks) > zero, material.ks, shown)
    shown = select3(largest(material.kd) > zero, material.kd, shown)
    return finish(hit.t, shown, none)
