"""The shader `path_tracer`: unidirectional, with one light sample and one scattered direction at each vertex.

The estimator is that of docs/transport.md: emission and the light sample are combined by multiple importance sampling
(power heuristic, Veach 1997), and Russian roulette ends paths without bias. The light sample may be one of several
candidates (`direct_light`).
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.bsdf import Lobes
from engines.numpy_reference.context import MOST_NULL_LOBES, Context, Vertex
from engines.numpy_reference.direct_light import resample_light, sample_light
from engines.numpy_reference.guiding import GuidedScattering, Records, recorded
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.vectors import Array, Indices, Mask, dot

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
    vertex: Array
    """The last vertex, and the geometric normal there, towards the viewer. Vertices in media have no normals: both are 0."""
    geometric: Array
    origin_primitive: Indices
    """Id of the primitive that the ray starts from, -1 for none."""
    lead: Array
    """Metres from the surface that the ray has left to its origin, along the ray."""
    medium: Indices
    """The medium along the ray."""
    depth: Indices
    """Segments so far, 1 on the way from the camera."""
    crossed: Array
    """Metres since the last vertex to where the ray starts: 0 unless null lobes were crossed freely."""
    direct_view: Mask
    """Whether the camera sees along the ray: null lobes alone lie behind it."""
    eta: Array
    """Index of refraction where the ray is, over that where the camera is."""
    odds: Array
    """Where paths are guided: how many times more likely their directions were than by BSDFs alone, each at least 1."""

    def take(self, lanes: Indices) -> Paths:
        """Some of the paths."""
        return Paths(*(field.take(lanes, axis=-1) for field in self))

    def beside(self, others: Paths) -> Paths:
        """These and the others."""
        joined: list[Any] = [np.concatenate(pair, axis=-1) for pair in zip(self, others, strict=True)]
        return Paths(*joined)


class Scattering(Protocol):
    """What scatters light at the vertices of paths."""

    def evaluate(self, at: Any, wi: Array, /) -> Array:
        """(3, n) of light along `wi` (3, n), without lobes that are deltas."""
        ...

    def pdf(self, at: Any, wi: Array, /) -> Array:
        """(n,) per solid angle, with which paths are scattered along `wi`."""
        ...


def Li(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) estimates of the radiance along rays (3, n), sample number `sample` of their pixels (n,)."""
    total = np.zeros((3, pixel.size))
    paths = camera_paths(context, origin, direction, pixel)
    records: list[Records] = []
    for event in range(1, context.options["max_depth"] + MOST_NULL_LOBES):
        context.check()
        hits = context.closest(paths.origin, paths.direction, paths.origin_primitive)
        before, paths, scattered = surface_vertices(context, paths, hits, total, sample, event)
        if not paths.lane.size:
            break
        if context.guide is not None:
            records.append(_record(context.guide, before, paths, scattered, total))
        paths = roulette(context, paths, scattered & (paths.depth > context.options["rr_depth"]), sample, base_of(event))
    if context.guide is not None:
        for found in records:
            context.guide.add(found, total)
    return total


def camera_paths(context: Context, origin: Array, direction: Array, pixel: Indices) -> Paths:
    """Paths that start along rays (3, n) of the camera."""
    n = pixel.size
    return Paths(
        lane=np.arange(n),
        pixel=pixel,
        origin=origin,
        direction=direction,
        throughput=np.ones((3, n)),
        pdf=np.full(n, np.inf),
        normal=np.zeros((3, n)),
        vertex=np.zeros((3, n)),
        geometric=np.zeros((3, n)),
        origin_primitive=np.full(n, -1),
        lead=np.zeros(n),
        medium=np.full(n, context.camera_medium),
        depth=np.ones(n, np.int64),
        crossed=np.zeros(n),
        direct_view=np.ones(n, bool),
        eta=np.ones(n),
        odds=np.ones(n),
    )


def surface_vertices(
    context: Context, paths: Paths, hits: Nearest, total: Array, sample: int, event: int
) -> tuple[Paths, Paths, Mask]:
    """What the rays of paths find; emission and light samples are added to `total` (3, lanes). The paths that go on, as they
    were and as they are, and whether each has left a vertex."""
    total[:, paths.lane] += _environment(context, paths, np.flatnonzero(hits.primitive_id < 0))
    arrived = np.flatnonzero(hits.primitive_id >= 0)
    paths, hits = paths.take(arrived), hits.take(arrived)
    at = context.surface(paths.origin, paths.direction, hits)
    absent = _absent(context, paths, at)
    total[:, paths.lane] += np.where(absent, 0.0, _emission(context, paths, at, hits.t))
    goes_on = paths.depth < context.options["max_depth"]
    if not (goes_on | absent | context.crosses_freely).any():
        none = paths.take(np.flatnonzero(goes_on))
        return none, none, np.zeros(0, bool)
    base = base_of(event)
    at, uc = context.materials.walk(at, context.draw(paths.pixel, sample, base + LOBE))
    lit = np.flatnonzero(goes_on & ~absent & context.materials.has(at, Lobes.NON_SPECULAR))
    scattering = context.materials if context.guide is None else context.guide
    total[:, paths.lane[lit]] += direct_light(context, paths.take(lit), at.take(lit), scattering, sample, base)
    following, scattered, kept = _scattered(context, paths, at, absent, hits.t, uc, sample, event)
    return paths.take(kept), following, scattered


def _record(guide: GuidedScattering, before: Paths, paths: Paths, scattered: Mask, total: Array) -> Records:
    """The directions in which paths have just been `scattered` at vertices; `before`: the same paths before that."""
    kept = np.flatnonzero(scattered & recorded(paths.pdf, before.depth))
    throughput, paths = before.throughput.take(kept, axis=1), paths.take(kept)
    return guide.record(paths.lane, paths.vertex, paths.direction, throughput, total.take(paths.lane, axis=1))


def base_of(event: int) -> int:
    """The first dimension of the vertex at the end of a path's ray number `event`, from 1 on."""
    return 2 + 8 * (event - 1)


def _absent(context: Context, paths: Paths, at: SurfaceInteraction) -> Mask:
    """(n,) whether the surface is an emitter that hides from the camera."""
    if not context.options["hide_emitters"]:
        return np.zeros(paths.depth.size, bool)
    return (paths.depth == 1) & context.materials.emits(at)


def _environment(context: Context, paths: Paths, missed: Indices) -> Array:
    """(3, n) radiance of the lights at infinity that rays find, weighted; 0 for rays not in `missed`."""
    found = np.zeros(paths.direction.shape)
    if context.options["hide_emitters"]:
        missed = missed[~paths.direct_view[missed]]
    if missed.size:
        lost = paths.take(missed)
        for light in context.lights.infinite:
            pdf = light.pdf(lost.direction, lost.normal)
            inverse_pmf = context.light_sampler.inverse_pmf(np.full(missed.size, light.light), lost.vertex, lost.geometric)
            weight = _weight_of_scattering(context, lost.pdf, pdf / inverse_pmf, listed=np.isfinite(inverse_pmf))
            found[:, missed] += lost.throughput * weight * light.Li(lost.direction)
    return found


def _emission(context: Context, paths: Paths, at: SurfaceInteraction, distance: Array) -> Array:
    """(3, n) radiance that surfaces emit along the rays, weighted."""
    found = np.zeros(paths.direction.shape)
    if not context.materials.emissive:
        return found
    emitted = context.materials.emitted(at)
    lanes = np.flatnonzero((emitted > 0.0).any(axis=0))
    if lanes.size:
        paths = paths.take(lanes)
        start = paths.origin - paths.crossed * paths.direction
        pdf = context.lights.pdf(at.take(lanes), start, paths.crossed + distance[lanes])
        pdf = pdf / _inverse_pmf(context, paths, at.primitive_id[lanes])
        weight = _weight_of_scattering(context, paths.pdf, pdf, listed=pdf > 0.0)
        found[:, lanes] = paths.throughput * weight * emitted.take(lanes, axis=1)
    return found


def _inverse_pmf(context: Context, paths: Paths, primitive_id: Indices) -> Array:
    """(n,) 1 / the probability with which the lights of the primitives hit would have been chosen; 1 of no light."""
    light, inverse_pmf = context.lights.of_primitive(primitive_id), np.ones(primitive_id.size)
    listed = np.flatnonzero(light >= 0)
    if listed.size:
        left = paths.take(listed)
        inverse_pmf[listed] = context.light_sampler.inverse_pmf(light[listed], left.vertex, left.geometric)
    return inverse_pmf


def _weight_of_scattering(context: Context, pdf: Array, pdf_light: Array, listed: Mask) -> Array:
    """(n,) weights of light that scattered rays have found, given the pdfs of scattering and of the light's sample."""
    direct = context.options["direct"]
    if direct == "bsdf":
        return np.ones(pdf.size)
    only_way = np.isinf(pdf) | ~listed
    if direct == "light":
        return np.where(only_way, 1.0, 0.0)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = pdf_light / pdf
        return np.where(only_way, 1.0, 1.0 / (1.0 + ratio * ratio))


def direct_light(context: Context, paths: Paths, at: Vertex, scattering: Scattering, sample: int, base: int) -> Array:
    """(3, n) light from one sample of one light, which vertices scatter but for lobes that are deltas."""
    found, pixel = np.zeros(paths.direction.shape), paths.pixel
    if not context.lights.count or not pixel.size:
        return found
    # which light, and where on it
    candidates = context.options["light_candidates"]
    u0, u1, u = (context.draw(pixel, sample, base + k) for k in (POINT_U0, POINT_U1, LIGHT))
    if candidates == 1:
        sampled = sample_light(context, at, u0, u1, u)
    else:
        sampled = resample_light(context, at, u0, u1, u, context.draw(pixel, sample, base + ROULETTE), candidates)
    lanes = np.flatnonzero((sampled.light.weight > 0.0).any(axis=0))
    (light, inverse_pmf, scale), at = sampled.take(lanes), at.take(lanes)
    # what it adds
    value = scattering.evaluate(at, light.wi)
    weight = np.ones(lanes.size)
    if context.options["direct"] == "mis":
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = scattering.pdf(at, light.wi) / (light.pdf / inverse_pmf)
            weight = 1.0 / (1.0 + ratio * ratio)
    with np.errstate(invalid="ignore", over="ignore"):
        added = paths.throughput.take(lanes, axis=1) * value * light.weight * (at.cosine(light.wi) * scale * weight)
    # unless something stands in between
    reaches = (value != 0.0).any(axis=0)
    lit = np.flatnonzero(reaches & (added != 0.0).any(axis=0))  # NaN is not 0: it is traced, and counted as a bad sample
    way = at.take(lit), light.wi.take(lit, axis=1), light.distance[lit]
    if context.crosses_freely or context.media.any:
        visible = context.transmittance(*way, paths.medium[lanes[lit]])
    else:
        visible = context.unoccluded(*way)
    found[:, lanes[lit]] = np.where(visible, visible * added.take(lit, axis=1), 0.0)
    return found


def _scattered(
    context: Context, paths: Paths, at: SurfaceInteraction, absent: Mask, distance: Array, uc: Array, sample: int, event: int
) -> tuple[Paths, Mask, Indices]:
    """The paths that go on, each in a direction that has been sampled, whether each has left a vertex, and which of all they
    are. `uc` (n,) chooses lobes; where the surface is `absent` (n,), the ray goes straight on."""
    base = base_of(event)
    u0, u1 = (context.draw(paths.pixel, sample, base + k) for k in (DIRECTION_U0, DIRECTION_U1))
    if context.guide is None:
        found, odds = context.materials.sample(at, uc, u0, u1), np.ones(uc.size)
    else:
        found, odds = context.guide.sample(at, uc, u0, u1)
    null, wi = absent | context.materials.passes(at, found.wi), np.where(absent, -at.wo, found.wi)
    weight, eta = np.where(absent, 1.0, found.weight), np.where(absent, 1.0, context.materials.eta(at, found.wi))
    vertex = ~null if context.crosses_freely else ~absent
    following = paths._replace(
        origin=at.spawn(wi),
        direction=wi,
        throughput=paths.throughput * weight,
        origin_primitive=at.primitive_id,
        lead=at.offset * np.abs(dot(at.geometric, wi)),
        medium=context.media.beyond(at, wi, paths.medium),
        pdf=np.where(vertex, found.pdf, paths.pdf),
        normal=np.where(vertex, at.normal, paths.normal),
        vertex=np.where(vertex, at.point, paths.vertex),
        geometric=np.where(vertex, at.geometric, paths.geometric),
        depth=paths.depth + vertex,
        crossed=np.where(vertex, 0.0, paths.crossed + distance),
        direct_view=paths.direct_view & null,
        eta=paths.eta * eta,
        odds=paths.odds * np.where(absent, 1.0, odds),
    )
    goes_on = (weight != 0.0).any(axis=0) & (following.depth <= context.options["max_depth"])
    goes_on &= event + 1 - following.depth < MOST_NULL_LOBES
    kept = np.flatnonzero(goes_on)
    return following.take(kept), vertex[kept], kept


def roulette(context: Context, paths: Paths, played: Mask, sample: int, base: int) -> Paths:
    """The paths that survive where it is `played`, with the weight of those that do not; and the others. Refraction scales
    radiance by 1/eta^2, which says nothing about what a path is worth; nor does the small weight of a likely direction."""
    if not played.any():
        return paths
    survival = np.minimum(paths.throughput.max(axis=0, initial=0.0) * (paths.eta**2 * paths.odds), 0.95)
    kept = np.flatnonzero(~played | (context.draw(paths.pixel, sample, base + ROULETTE) < survival))
    paths = paths.take(kept)
    return paths._replace(throughput=paths.throughput / np.where(played, survival, 1.0)[kept])
