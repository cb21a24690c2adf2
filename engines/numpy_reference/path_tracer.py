"""The shader `path_tracer`: unidirectional, with one light sample and one scattering lobe at each vertex.

The estimator is that of docs/transport.md: emission and the light sample are combined by multiple importance sampling
(power heuristic, Veach 1997), and Russian roulette ends paths without bias.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.context import Context
from engines.numpy_reference.material import Lobes, lobes, mirrored, refracted
from engines.numpy_reference.surface import Surface
from engines.numpy_reference.vectors import Array, Indices, cosine_hemisphere, dot

POINT_U0, POINT_U1, LIGHT, LOBE, DIRECTION_U0, DIRECTION_U1, ROULETTE = range(7)
"""Dimensions of a vertex, counted from its base."""


class Paths(NamedTuple):
    """n paths on their way. `pdf` is that of the last scattering, per solid angle: inf from the camera, a mirror or
    glass. `normal` is the shading normal at the vertex the ray left."""

    lane: Indices
    pixel: Indices
    origin: Array
    direction: Array
    throughput: Array
    pdf: Array
    normal: Array
    left: Indices
    """Rank of the primitive that the ray starts from, -1 for the camera's."""

    def take(self, lanes: Indices) -> Paths:
        """Some of the paths."""
        return Paths(*(field.take(lanes, axis=-1) for field in self))

    def none(self) -> Paths:
        """No paths at all."""
        return self.take(np.zeros(0, np.int64))


def radiance(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) estimates of the radiance along rays (3, n), sample number `sample` of their pixels (n,)."""
    n = pixel.size
    total = np.zeros((3, n))
    paths = Paths(
        np.arange(n), pixel, origin, direction, np.ones((3, n)), np.full(n, np.inf), np.zeros((3, n)), np.full(n, -1)
    )
    for depth in range(1, context.options["max_depth"] + 1):
        context.check()
        # the next surface
        hits = context.closest(paths.origin, paths.direction, paths.left)
        total[:, paths.lane] += _from_the_sky(context, paths, np.flatnonzero(hits.rank < 0))
        arrived = np.flatnonzero(hits.rank >= 0)
        paths, hits = paths.take(arrived), hits.take(arrived)
        surface = context.surface(paths.origin, paths.direction, hits)
        total[:, paths.lane] += _emission(context, paths, surface, hits.t)
        if depth == context.options["max_depth"] or not paths.lane.size:
            break
        # what it does with light
        there = lobes(context.materials, surface, paths.direction)
        base = 2 + 8 * (depth - 1)
        total[:, paths.lane] += _direct(context, paths, surface, there, sample, base)
        paths = _scattered(context, paths, surface, there, sample, base)
        if depth >= context.options["rr_depth"]:
            paths = _roulette(context, paths, sample, base)
    return total


def _from_the_sky(context: Context, paths: Paths, missed: Indices) -> Array:
    """(3, n) radiance of the environments that rays reach, weighted; 0 for rays not in `missed`."""
    light = np.zeros(paths.direction.shape)
    if missed.size:
        lost = paths.take(missed)
        for _, environment in context.lights.environments:
            pdf = environment.pdf(lost.direction, lost.normal)
            weight = _weight_of_scattering(context, lost.pdf, pdf, listed=np.ones(missed.size, bool))
            light[:, missed] += lost.throughput * weight * environment.radiance(lost.direction)
    return light


def _emission(context: Context, paths: Paths, surface: Surface, distance: Array) -> Array:
    """(3, n) radiance that surfaces emit along the rays, weighted."""
    light = np.zeros(paths.direction.shape)
    if not context.materials.emissive:
        return light
    emitted = context.materials.emitted(surface)
    lanes = np.flatnonzero((emitted > 0.0).any(axis=0))
    if lanes.size:
        paths = paths.take(lanes)
        pdf = context.lights.pdf(surface.take(lanes), paths.origin, paths.direction, distance[lanes])
        weight = _weight_of_scattering(context, paths.pdf, pdf, listed=pdf > 0.0)
        light[:, lanes] = paths.throughput * weight * emitted.take(lanes, axis=1)
    return light


def _weight_of_scattering(context: Context, pdf: Array, pdf_light: Array, listed: np.ndarray) -> Array:
    """(n,) weights of light that scattered rays have found, given the pdfs of scattering and of the light's sample."""
    direct = context.options["direct"]
    if direct == "bsdf":
        return np.ones(pdf.size)
    only_way = np.isinf(pdf) | ~listed
    if direct == "light":
        return np.where(only_way, 1.0, 0.0)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = pdf_light / context.lights.count / pdf
        return np.where(only_way, 1.0, 1.0 / (1.0 + ratio * ratio))


def _direct(context: Context, paths: Paths, surface: Surface, there: Lobes, sample: int, base: int) -> Array:
    """(3, n) light from one sample of one light, chosen evenly, on the diffuse lobe."""
    light = np.zeros(paths.direction.shape)
    count = context.lights.count
    lanes = np.flatnonzero((there.diffuse > 0.0).any(axis=0))
    if not count or not lanes.size:
        return light
    # which light, and where on it
    pixel = paths.pixel[lanes]
    scaled = context.draw(pixel, sample, base + LIGHT) * count
    chosen = np.minimum(scaled.astype(np.int64), count - 1)
    rest = scaled - chosen
    if context.options["direct"] == "bsdf":
        kept = np.flatnonzero(context.lights.delta[chosen])
        lanes, pixel, chosen, rest = lanes[kept], pixel[kept], chosen[kept], rest[kept]
    u0, u1 = context.draw(pixel, sample, base + POINT_U0), context.draw(pixel, sample, base + POINT_U1)
    at = surface.take(lanes)
    found = context.lights.sample(chosen, at.point, at.normal, u0, u1, rest)
    # what it adds
    there = there.take(lanes)
    cosine = dot(at.normal, found.wi)
    weight = np.ones(lanes.size)
    if context.options["direct"] == "mis":
        pdf_scattering = there.d / (there.d + there.r + there.t) * cosine / np.pi
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = pdf_scattering / (found.pdf / count)
            weight = 1.0 / (1.0 + ratio * ratio)
    with np.errstate(invalid="ignore", over="ignore"):
        brdf = there.diffuse / np.pi
        added = paths.throughput.take(lanes, axis=1) * brdf * found.arriving * (cosine * count * weight)
    # unless something stands in between
    facing = (cosine > 0.0) & (dot(at.geometric, found.wi) > 0.0) & (found.arriving > 0.0).any(axis=0)
    lit = np.flatnonzero(facing & (added != 0.0).any(axis=0))  # NaN is not 0: it is traced, and counted as a bad sample
    clear = context.unoccluded(at.take(lit), found.wi.take(lit, axis=1), found.distance[lit])
    lit = lit[clear]
    light[:, lanes[lit]] = added.take(lit, axis=1)
    return light


def _scattered(context: Context, paths: Paths, surface: Surface, there: Lobes, sample: int, base: int) -> Paths:
    """The paths that go on, each along one lobe, chosen in proportion to the lobes' weights."""
    paths = paths._replace(left=surface.rank)
    q = there.d + there.r + there.t
    u = context.draw(paths.pixel, sample, base + LOBE) * q
    diffuse, mirror = u < there.d, (u >= there.d) & (u < there.d + there.r)
    parts = []
    for chosen, scatter in ((diffuse, _diffuse), (mirror, _mirror), (~diffuse & ~mirror & (q > 0.0), _refraction)):
        lanes = np.flatnonzero(chosen)
        if lanes.size:
            parts.append(scatter(context, paths.take(lanes), surface.take(lanes), there.take(lanes), sample, base))
    return Paths(*(np.concatenate(fields, axis=-1) for fields in zip(*parts, strict=True))) if parts else paths.none()


def _diffuse(context: Context, paths: Paths, at: Surface, there: Lobes, sample: int, base: int) -> Paths:
    u0 = context.draw(paths.pixel, sample, base + DIRECTION_U0)
    u1 = context.draw(paths.pixel, sample, base + DIRECTION_U1)
    wi = cosine_hemisphere(at.normal, u0, u1)
    q = there.d + there.r + there.t
    throughput = paths.throughput * there.diffuse * (q / there.d)
    pdf = there.d / q * dot(at.normal, wi) / np.pi
    paths = paths._replace(origin=at.leave(), direction=wi, throughput=throughput, pdf=pdf, normal=at.normal)
    return paths.take(np.flatnonzero(dot(at.geometric, wi) > 0.0))


def _mirror(context: Context, paths: Paths, at: Surface, there: Lobes, sample: int, base: int) -> Paths:
    q = there.d + there.r + there.t
    throughput = paths.throughput * there.mirror * (q / there.r)
    wi = mirrored(at, paths.direction)
    paths = paths._replace(origin=at.leave(), direction=wi, throughput=throughput, pdf=np.full(q.size, np.inf))
    return paths.take(np.flatnonzero(dot(at.geometric, wi) > 0.0))


def _refraction(context: Context, paths: Paths, at: Surface, there: Lobes, sample: int, base: int) -> Paths:
    q = there.d + there.r + there.t
    bent = refracted(context.materials, at, paths.direction)
    throughput = paths.throughput * there.refraction * (q / there.t * bent.scale)
    origin = np.where(bent.total, at.leave(), at.leave(inwards=True))
    paths = paths._replace(origin=origin, direction=bent.direction, throughput=throughput, pdf=np.full(q.size, np.inf))
    side = dot(at.geometric, bent.direction)
    return paths.take(np.flatnonzero(np.where(bent.total, side, -side) > 0.0))


def _roulette(context: Context, paths: Paths, sample: int, base: int) -> Paths:
    """The paths that survive, with the weight of those that do not."""
    survival = np.minimum(paths.throughput.max(axis=0, initial=0.0), 0.95)
    kept = np.flatnonzero(context.draw(paths.pixel, sample, base + ROULETTE) < survival)
    paths = paths.take(kept)
    return paths._replace(throughput=paths.throughput / survival[kept])
