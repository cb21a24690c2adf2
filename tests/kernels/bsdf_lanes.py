"""BSDF models of the kernels over arrays, in the local frame: z is the normal, x the tangent. Directions are (3, n)."""

from __future__ import annotations

from functools import cache

import numpy as np

from engines.kernels.compile.jit import kernel
from engines.kernels.compile.memory import array_at
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lookups import Table
from engines.kernels.flatten.materials import MODELS, leaf_features, model_of, parameters_of
from engines.kernels.integrators.interface import SurfaceInteraction
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION, SPECULAR_TRANSMISSION
from engines.kernels.lane.vector import Vec3
from engines.kernels.rows import BSDF_PARAMETERS

LOBES = {"all": ALL, "reflection": SPECULAR_REFLECTION, "transmission": SPECULAR_TRANSMISSION}


@cache
def _compiled(kind, features, real):
    lane = MODELS[kind].lane(features)
    evaluate, pdf_of, sample_of = lane.evaluate, lane.pdf, lane.sample

    def run(numbers, table_address, front, which, wo, wi, draws, value, pdf, found, weight, found_pdf, through):
        p = numbers
        parameters = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14])
        tables = array_at(table_address, real)
        zero, one = real(0), real(1)
        up, east, none = Vec3(zero, zero, one), Vec3(one, zero, zero), Vec3(zero, zero, zero)
        for i in range(wo.shape[1]):
            d = Vec3(-wo[0, i], -wo[1, i], -wo[2, i])
            si = SurfaceInteraction(False, one, none, up, up, d, none, front, east, none, zero, tables)
            towards = Vec3(wi[0, i], wi[1, i], wi[2, i])
            f = evaluate(parameters, si, towards)
            value[0, i], value[1, i], value[2, i] = f.color.x * f.scale, f.color.y * f.scale, f.color.z * f.scale
            pdf[i] = pdf_of(parameters, si, towards)
            s = sample_of(parameters, si, draws[0, i], draws[1, i], draws[2, i], which)
            scale = s.weight.scale if s.valid else zero
            found[0, i], found[1, i], found[2, i] = s.wi.x, s.wi.y, s.wi.z
            weight[0, i], weight[1, i], weight[2, i] = (
                s.weight.color.x * scale,
                s.weight.color.y * scale,
                s.weight.color.z * scale,
            )
            found_pdf[i], through[i] = s.pdf if s.valid else zero, s.transmitted

    return kernel(run)


class Lanes:
    """A leaf of a scene. `front`: whether the surface is met from its front."""

    def __init__(self, leaf, front=True, real=np.float64, features=None):
        numbers, tables = [], [0.0]
        for value in parameters_of(leaf):
            if isinstance(value, Table):
                numbers.append(len(tables))
                tables += value.numbers
                tables[0] = len(tables)
            else:
                numbers.append(value)
        features = features or SceneFeatures(**{**leaf_features([leaf]), "tangents": True})
        self._run = _compiled(model_of(leaf), features, real)
        self._numbers = np.array(numbers + [0.0] * (BSDF_PARAMETERS - len(numbers)), real)
        self._tables, self._front, self._real = np.array(tables, real), front, real

    def _all(self, wo, wi, draws, which=ALL):
        wo, wi, draws = np.broadcast_arrays(wo, wi, draws)
        wo, wi, draws = (np.ascontiguousarray(x, self._real) for x in (wo, wi, draws))
        n = wo.shape[1]
        out = [np.zeros(shape, self._real) for shape in ((3, n), n, (3, n), (3, n), n)] + [np.zeros(n, np.bool_)]
        self._run(self._numbers, self._tables.ctypes.data, self._front, which, wo, wi, draws, *out)
        return out

    def evaluate(self, wo, wi):
        """(3, n) f |cos|."""
        return self._all(wo, wi, np.zeros((3, 1)))[0]

    def pdf(self, wo, wi):
        """(n,)"""
        return self._all(wo, wi, np.zeros((3, 1)))[1]

    def sample(self, wo, draws, lobes="all"):
        """(wi (3, n), weight (3, n), pdf (n,), transmitted (n,)); weight and pdf are 0 where there is no sample."""
        return self._all(wo, np.array([[0.0], [0.0], [1.0]]), draws, LOBES[lobes])[2:]
