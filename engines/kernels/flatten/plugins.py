"""Kinds of the lights and BSDFs that plugins bring: each enters the registry of its part with the first scene that has it."""

from __future__ import annotations

import math
import threading
import zlib
from functools import cache
from typing import Any

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION, SPECULAR_TRANSMISSION, BSDFSample, LaneBSDF, Spectrum
from engines.kernels.lane.lights import LightSample
from engines.kernels.lane.vector import dot

FIRST_KIND, KINDS = 1 << 16, 1 << 20
"""Rows hold kinds in float32, which is exact to 2^24."""
_lock = threading.Lock()


def kind_of(models: dict[int, Any], name: str, model: Any) -> int:
    """The kind of a plugin's model in a registry. It follows from the plugin's name, so that the machine code on disk is
    that of processes which have seen other plugins, too."""
    with _lock:
        for kind, known in models.items():
            if known == model:
                return kind
        kind = FIRST_KIND + zlib.crc32(name.encode()) % KINDS
        while kind in models:
            kind += 1
        models[kind] = model
        return kind


@cache
def light_sample(sample: Any) -> Any:
    """The lane function of a plugin's light. No scattered ray finds the light, so its density weighs nothing: it counts
    as a delta light's."""

    @inline
    def of_plugin(light, p, normal, u0, u1):
        found = sample(light, p, normal, u0, u1)
        zero = const(0.0, u0)
        pdf = select(found.pdf > zero, const(math.inf, zero), zero)
        return LightSample(found.wi, found.distance, found.radiance, pdf)

    return of_plugin


@cache
def bsdf_functions(functions: LaneBSDF, reflection: bool, transmission: bool, above: bool) -> LaneBSDF:
    """The lane functions of a plugin's BSDF, which has these specular lobes and no others; `above`: what the plugin says of
    directions below the surface is not asked for."""
    sample_any, evaluate_any, pdf_any = functions.sample, functions.evaluate, functions.pdf

    @inline
    def evaluate(parameters, si, wi):
        found, zero = evaluate_any(parameters, si, wi), const(0.0, si.t)
        return Spectrum(found.color, select(dot(si.normal, wi) > zero, found.scale, zero))

    @inline
    def pdf(parameters, si, wi):
        zero = const(0.0, si.t)
        return select(dot(si.normal, wi) > zero, pdf_any(parameters, si, wi), zero)

    @inline
    def sample(parameters, si, u_lobe, u0, u1, which):
        found = sample_any(parameters, si, u_lobe, u0, u1, which)
        there = (which == ALL) | (reflection & (which == SPECULAR_REFLECTION))
        there = there | (transmission & (which == SPECULAR_TRANSMISSION))
        return BSDFSample(found.wi, found.weight, found.pdf, found.transmitted, found.valid & there)

    functions = functions._replace(sample=sample)
    return functions._replace(evaluate=evaluate, pdf=pdf) if above else functions
