"""The shaders `whitted` (1980) and `no_shadows`: every light at every hit; the former follows mirrors and glass."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.bsdf import Lobes
from engines.numpy_reference.context import Context
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.path_tracer import LOBE
from engines.numpy_reference.vectors import Array, Indices, dot


def Li(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) radiance along rays (3, n): `whitted`."""
    return _traced(context, origin, direction, pixel, sample, depth=1)


def Li_without_shadows(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) radiance along rays (3, n): `no_shadows`, where mirrors and glass are black."""
    hits = context.closest(origin, direction)
    total = _environment_where_missed(context, direction, hits)
    arrived = np.flatnonzero(hits.primitive_id >= 0)
    at = _surface(context, origin, direction, hits, arrived)
    emitted, at = context.materials.emitted(at), _walked(context, at, pixel[arrived], sample, depth=1)
    total[:, arrived] = emitted + _local(context, at, pixel[arrived], sample, depth=1, shadows=False)
    return total


def _base(context: Context, depth: int, light: int) -> int:
    """The first dimension of a light's sample at a vertex; that of the first light also has the draw that walks wrappers."""
    return 2 + 8 * ((depth - 1) * max(context.lights.count, 1) + light)


def _walked(context: Context, at: SurfaceInteraction, pixel: Indices, sample: int, depth: int) -> SurfaceInteraction:
    """The points as their BSDFs see them, by the draw of the first light."""
    return context.materials.walk(at, context.draw(pixel, sample, _base(context, depth, 0) + LOBE))[0]


def _traced(
    context: Context,
    origin: Array,
    direction: Array,
    pixel: Indices,
    sample: int,
    depth: int,
    origin_primitive: Indices | None = None,
) -> Array:
    context.check()
    hits = context.closest(origin, direction, origin_primitive)
    total = _environment_where_missed(context, direction, hits)
    arrived = np.flatnonzero(hits.primitive_id >= 0)
    if not arrived.size:
        return total
    at = _surface(context, origin, direction, hits, arrived)
    pixel = pixel[arrived]
    emitted, at = context.materials.emitted(at), _walked(context, at, pixel, sample, depth)
    light = emitted + _local(context, at, pixel, sample, depth, shadows=True)
    if depth < context.options["max_depth"]:
        for lobe in (Lobes.SPECULAR_REFLECTION, Lobes.SPECULAR_TRANSMISSION):
            light += _through(context, at, pixel, sample, depth, lobe)
    total[:, arrived] = light
    return total


def _through(context: Context, at: SurfaceInteraction, pixel: Indices, sample: int, depth: int, lobe: Lobes) -> Array:
    """(3, n) what a mirror shows, or what lies behind glass."""
    light = np.zeros(at.point.shape)
    lanes, found = context.materials.follow(at, lobe)
    kept = np.flatnonzero((found.weight != 0.0).any(axis=0))
    if not kept.size:
        return light
    lanes, wi, weight = lanes[kept], found.wi.take(kept, axis=1), found.weight.take(kept, axis=1)
    there = at.take(lanes)
    seen = _traced(context, there.spawn(wi), wi, pixel[lanes], sample, depth + 1, there.primitive_id)
    light[:, lanes] = weight * seen
    return light


def _environment_where_missed(context: Context, direction: Array, hits: Nearest) -> Array:
    return np.where(hits.primitive_id < 0, context.environment(direction), 0.0)


def _surface(context: Context, origin: Array, direction: Array, hits: Nearest, arrived: Indices) -> SurfaceInteraction:
    return context.surface(origin.take(arrived, axis=1), direction.take(arrived, axis=1), hits.take(arrived))


def _local(context: Context, at: SurfaceInteraction, pixel: Indices, sample: int, depth: int, shadows: bool) -> Array:
    """(3, n) the ambient term, and one sample of every light through the lobes that are no deltas."""
    total = context.options["ambient"] * context.materials.diffuse(at)
    lanes = np.flatnonzero(context.materials.has(at, Lobes.NON_SPECULAR))
    if lanes.size:
        there = at.take(lanes)
        for j in range(context.lights.count):
            total[:, lanes] += _lit(context, there, pixel[lanes], sample, _base(context, depth, j), j, shadows)
    return total


def _lit(context: Context, at: SurfaceInteraction, pixel: Indices, sample: int, base: int, light: int, shadows: bool) -> Array:
    """(3, n) what one sample of a light adds."""
    u0, u1, uc = (context.draw(pixel, sample, base + k) for k in range(3))
    found = context.lights.sample(np.full(pixel.size, light), at.point, at.normal, u0, u1, uc)
    value = context.materials.evaluate(at, found.wi)
    lit = np.flatnonzero((value != 0.0).any(axis=0) & (found.weight > 0.0).any(axis=0))
    if shadows:
        towards = found.wi.take(lit, axis=1)
        lit = lit[context.unoccluded(at.take(lit), towards, found.distance[lit])]
    cosine = np.abs(dot(at.normal, found.wi))[lit]
    added = np.zeros(value.shape)
    added[:, lit] = value.take(lit, axis=1) * found.weight.take(lit, axis=1) * cosine
    return added
