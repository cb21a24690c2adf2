"""The shaders `whitted` (1980) and `no_shadows`: every light at every hit; the former follows mirrors and glass."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.context import Context
from engines.numpy_reference.material import lobes, mirrored, refracted
from engines.numpy_reference.nearest import Nearest
from engines.numpy_reference.surface import Surface
from engines.numpy_reference.vectors import Array, Indices, dot


def radiance(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) radiance along rays (3, n): `whitted`."""
    return _radiance(context, origin, direction, pixel, sample, depth=1)


def radiance_without_shadows(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) radiance along rays (3, n): `no_shadows`, where mirrors and glass are black."""
    hits = context.closest(origin, direction)
    total = _sky_where_missed(context, direction, hits)
    arrived = np.flatnonzero(hits.rank >= 0)
    surface = _surface(context, origin, direction, hits, arrived)
    total[:, arrived] = _local(context, surface, pixel[arrived], sample, depth=1, shadows=False)
    return total


def _radiance(
    context: Context,
    origin: Array,
    direction: Array,
    pixel: Indices,
    sample: int,
    depth: int,
    left: Indices | None = None,
) -> Array:
    context.check()
    hits = context.closest(origin, direction, left)
    total = _sky_where_missed(context, direction, hits)
    arrived = np.flatnonzero(hits.rank >= 0)
    if not arrived.size:
        return total
    surface = _surface(context, origin, direction, hits, arrived)
    pixel, direction = pixel[arrived], direction.take(arrived, axis=1)
    light = _local(context, surface, pixel, sample, depth, shadows=True)
    if depth < context.options["max_depth"] and context.materials.specular:
        there = lobes(context.materials, surface, direction)
        # what the mirror shows
        wi = mirrored(surface, direction)
        go = np.flatnonzero((there.r > 0.0) & (dot(surface.geometric, wi) > 0.0))
        rays = surface.take(go).leave(), wi.take(go, axis=1)
        seen = _radiance(context, *rays, pixel[go], sample, depth + 1, surface.rank[go])
        light[:, go] += there.mirror.take(go, axis=1) * seen
        # what lies behind
        bent = refracted(context.materials, surface, direction)
        start = np.where(bent.total, surface.leave(), surface.leave(inwards=True))
        side = dot(surface.geometric, bent.direction)
        go = np.flatnonzero((there.t > 0.0) & (np.where(bent.total, side, -side) > 0.0))
        rays = start.take(go, axis=1), bent.direction.take(go, axis=1)
        seen = _radiance(context, *rays, pixel[go], sample, depth + 1, surface.rank[go])
        light[:, go] += there.refraction.take(go, axis=1) * bent.scale[go] * seen
    total[:, arrived] = light
    return total


def _sky_where_missed(context: Context, direction: Array, hits: Nearest) -> Array:
    return np.where(hits.rank < 0, context.sky(direction), 0.0)


def _surface(context: Context, origin: Array, direction: Array, hits: Nearest, arrived: Indices) -> Surface:
    return context.surface(origin.take(arrived, axis=1), direction.take(arrived, axis=1), hits.take(arrived))


def _local(context: Context, surface: Surface, pixel: Indices, sample: int, depth: int, shadows: bool) -> Array:
    """(3, n) emission, the ambient term, and one sample of every light on the diffuse part."""
    kd = context.materials.kd.take(surface.material, axis=1)
    light = context.materials.emitted(surface) + context.options["ambient"] * kd
    diffuse = np.flatnonzero((kd > 0.0).any(axis=0))
    at, pixel, kd = surface.take(diffuse), pixel[diffuse], kd.take(diffuse, axis=1)
    for j in range(context.lights.count if diffuse.size else 0):
        base = 2 + 8 * ((depth - 1) * context.lights.count + j)
        u0, u1, uc = (context.draw(pixel, sample, base + k) for k in range(3))
        found = context.lights.sample(np.full(pixel.size, j), at.point, at.normal, u0, u1, uc)
        cosine = dot(at.normal, found.wi)
        lit = np.flatnonzero((cosine > 0.0) & (dot(at.geometric, found.wi) > 0.0) & (found.arriving > 0.0).any(axis=0))
        if shadows:
            towards = found.wi.take(lit, axis=1)
            lit = lit[context.unoccluded(at.take(lit), towards, found.distance[lit])]
        light[:, diffuse[lit]] += kd.take(lit, axis=1) * found.arriving.take(lit, axis=1) * (cosine[lit] / np.pi)
    return light
