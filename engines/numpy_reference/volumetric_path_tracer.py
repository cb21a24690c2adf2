"""The shader `volumetric_path_tracer`: the path tracer in scenes with media, whose particles scatter light as surfaces do.

The estimator is that of docs/transport.md, "Media". What happens at surfaces is the path tracer's; light samples and paths
pass null lobes, and in media both lose what the way takes.
"""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.context import MOST_NULL_LOBES, Context
from engines.numpy_reference.media import MediumInteraction
from engines.numpy_reference.path_tracer import (
    DIRECTION_U0,
    DIRECTION_U1,
    Paths,
    base_of,
    camera_paths,
    direct_light,
    roulette,
    surface_vertices,
)
from engines.numpy_reference.vectors import Array, Indices

FLIGHT = 23
"""The dimension of a path's ray by which its flight through a medium is drawn, counted from the base of the vertex at its end:
an eighth one, which no vertex uses, and the lens neither."""


def Li(context: Context, origin: Array, direction: Array, pixel: Indices, sample: int) -> Array:
    """(3, n) estimates of the radiance along rays (3, n), sample number `sample` of their pixels (n,)."""
    total = np.zeros((3, pixel.size))
    paths = camera_paths(context, origin, direction, pixel)
    for event in range(1, context.options["max_depth"] + MOST_NULL_LOBES):
        context.check()
        base = base_of(event)
        hits = context.closest(paths.origin, paths.direction, paths.origin_primitive)
        # the way to the surface, or as far as the medium lets the ray fly
        distance = hits.t + paths.lead
        flight, weight = context.media.fly(
            paths.medium, paths.throughput, context.draw(paths.pixel, sample, base + FLIGHT), distance
        )
        paths = paths._replace(throughput=paths.throughput * weight)
        scatters = flight < distance  # a bad sample's flight is NaN: surfaces go on with it, and it is counted
        inside, outside = np.flatnonzero(scatters), np.flatnonzero(~scatters)
        found = _medium_vertices(context, paths.take(inside), flight[inside], distance[inside], total, sample, base)
        _, paths, scattered = surface_vertices(context, paths.take(outside), hits.take(outside), total, sample, event)
        paths, vertex = found.beside(paths), np.append(np.ones(found.lane.size, bool), scattered)
        alive = np.flatnonzero((paths.throughput != 0.0).any(axis=0))  # colours without a common channel leave nothing
        paths, vertex = paths.take(alive), vertex[alive]
        if not paths.lane.size:
            break
        paths = roulette(context, paths, vertex & (paths.depth > context.options["rr_depth"] + 1), sample, base)
    return total


def _medium_vertices(
    context: Context, paths: Paths, flight: Array, distance: Array, total: Array, sample: int, base: int
) -> Paths:
    """The paths that go on where media scatter them, `flight` metres (n,) from where they were and before the surface that lies
    `distance` (n,) away; what light samples give them there is added to `total`."""
    albedo = context.media.albedo.take(paths.medium, axis=1)
    paths = paths._replace(throughput=paths.throughput * albedo)
    goes_on = np.flatnonzero((paths.depth < context.options["max_depth"]) & (paths.throughput != 0.0).any(axis=0))
    paths = paths.take(goes_on)
    at = _interaction(context, paths, flight[goes_on], distance[goes_on])
    total[:, paths.lane] += direct_light(context, paths, at, context.media, sample, base)
    wi, pdf = context.media.sample(at, *(context.draw(paths.pixel, sample, base + k) for k in (DIRECTION_U0, DIRECTION_U1)))
    n = paths.lane.size
    return paths._replace(
        origin=at.point,
        direction=wi,
        origin_primitive=at.primitive_id,
        lead=np.zeros(n),
        pdf=pdf,
        normal=at.normal,
        vertex=at.point,
        geometric=at.geometric,
        depth=paths.depth + 1,
        crossed=np.zeros(n),
        direct_view=np.zeros(n, bool),
    )


def _interaction(context: Context, paths: Paths, flight: Array, distance: Array) -> MediumInteraction:
    """Where the flights end: so far from the surfaces behind and ahead that rounding puts no ray from there beyond them."""
    offset = context.tracer.offset * np.maximum(np.abs(paths.origin).max(axis=0, initial=0.0), flight)
    nearest = np.maximum(distance - offset, 0.5 * distance)
    place = np.minimum(np.maximum(flight, paths.lead), nearest)
    point = paths.origin + (place - paths.lead) * paths.direction
    return MediumInteraction(point, -paths.direction, paths.medium, offset)
