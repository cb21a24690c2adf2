"""`trace` and `occluded` by Mitsuba's scene: arrays of rays in the wavefront, one by one in the scalar variant."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.interface import Hits
from engines.peers.mitsuba.library import SCALAR
from engines.peers.mitsuba.stage import Stage
from engines.scene import Mesh, Triangle

Array = NDArray[Any]
FAR = 3e38
"""Where float32 ends."""


class Rays(NamedTuple):
    """Of n rays those that can hit, by index: origins, unit directions, lengths, and reach in metres."""

    n: int
    good: Array
    origin: Array
    direction: Array
    length: Array
    reach: Array


def rays_of(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> Rays:
    """Raises ValueError where the shapes are not (n, 3)."""
    origin, direction = (np.asarray(given, np.float64) for given in (origins, directions))
    origin, direction = (given.reshape(-1, 3) if given.size else np.zeros((0, 3)) for given in (origin, direction))
    if origin.shape != direction.shape:
        raise ValueError(f"origins {origin.shape} and directions {direction.shape}: both must have the shape (n, 3)")
    n = len(origin)
    reach = np.broadcast_to(np.asarray(t_max, np.float64), (n,))
    scale = np.abs(direction).max(axis=1, initial=0.0)
    good = np.flatnonzero(np.isfinite(origin).all(axis=1) & np.isfinite(scale) & (scale > 0.0) & (reach > 0.0))
    scaled = direction[good] / scale[good, None]
    long = np.linalg.norm(scaled, axis=1)
    length = scale[good] * long
    with np.errstate(over="ignore"):
        return Rays(n, good, origin[good], scaled / long[:, None], length, np.minimum(reach[good] * length, FAR))


def trace(stage: Stage, rays: Rays) -> Hits:
    """Closest hits; see `engines.interface.Renderer`."""
    t, place, index, normal, uv = (_each if stage.mi.variant() == SCALAR else _all)(stage, rays)
    n = rays.n
    hits = Hits(np.full(n, np.inf), np.full(n, -1), np.full(n, -1), np.zeros((n, 3)), np.zeros(n), np.zeros(n))
    hit = np.flatnonzero(np.isfinite(t))
    lanes = rays.good[hit]
    hits.t[lanes] = t[hit] / rays.length[hit]
    away = (normal * rays.direction).sum(axis=1) > 0.0
    hits.normal[lanes] = np.where(away[:, None], -normal, normal)[hit]
    for number in np.unique(place[hit]):
        part = stage.parts[stage.places[number]]
        chosen = hit[place[hit] == number]
        lanes, triangles = rays.good[chosen], isinstance(stage.scene.shapes[part.shape], (Mesh, Triangle))
        hits.shape[lanes] = part.shape
        hits.primitive[lanes] = part.primitives[index[chosen]] if triangles else part.primitives[0]
        if triangles:
            hits.u[lanes], hits.v[lanes] = uv[chosen].T[:: -1 if part.flipped else 1]
    return hits


def occluded(stage: Stage, rays: Rays) -> NDArray[np.bool_]:
    """Whether anything lies in (0, t_max); see `engines.interface.Renderer`."""
    dark = np.zeros(rays.n, bool)
    if stage.mi.variant() == SCALAR:
        blocked: Any = [stage.loaded.ray_test(ray) for ray in _rays_one_by_one(stage, rays)]
    else:
        blocked = stage.loaded.ray_test(_rays_at_once(stage, rays)).numpy() if len(rays.good) else []
    dark[rays.good] = blocked
    return dark


def _rays_at_once(stage: Stage, rays: Rays) -> Any:
    mi = stage.mi
    origin, direction = (np.ascontiguousarray(given.T, np.float32) for given in (rays.origin, rays.direction))
    reach = mi.Float(np.ascontiguousarray(rays.reach, np.float32))
    return mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction), reach, 0.0, mi.Color0f())


def _rays_one_by_one(stage: Stage, rays: Rays) -> Any:
    mi = stage.mi
    for origin, direction, reach in zip(rays.origin, rays.direction, rays.reach, strict=True):
        yield mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction), float(reach), 0.0, mi.Color0f())


def _all(stage: Stage, rays: Rays) -> tuple[Array, ...]:
    """t, place of the shape in Mitsuba's list, primitive, normal and barycentric coordinates of each ray."""
    mi, dr, count = stage.mi, stage.dr, len(rays.good)
    if count == 0 or not len(stage.places):
        return _nothing(count)
    ray = _rays_at_once(stage, rays)
    preliminary = stage.loaded.ray_intersect_preliminary(ray)
    si = preliminary.compute_surface_interaction(ray)
    number = dr.reinterpret_array(mi.UInt32, preliminary.shape).numpy()
    known = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]) for shape in stage.loaded.shapes()]
    place_of = np.zeros(max(known) + 1, np.int64)
    place_of[known] = np.arange(len(known))
    t = _wide(preliminary.t.numpy(), count)
    hit = np.isfinite(t)
    place = place_of[np.where(hit, _wide(number, count), known[0])]
    normal = np.stack([_wide(si.n[k].numpy(), count) for k in range(3)], axis=1)
    uv = np.stack([_wide(preliminary.prim_uv[k].numpy(), count) for k in range(2)], axis=1)
    return t, place, _wide(preliminary.prim_index.numpy(), count).astype(np.int64), normal, uv


def _wide(values: Array, count: int) -> Array:
    values = np.asarray(values)
    return np.broadcast_to(values, (count,)).astype(np.float64 if values.dtype.kind == "f" else np.int64)


def _each(stage: Stage, rays: Rays) -> tuple[Array, ...]:
    """The same, ray by ray."""
    t, place, index, normal, uv = _nothing(len(rays.good))
    number = {id(shape): place for place, shape in enumerate(stage.loaded.shapes())}
    by_name = {shape.id(): place for place, shape in enumerate(stage.loaded.shapes())}
    for k, ray in enumerate(_rays_one_by_one(stage, rays)):
        preliminary = stage.loaded.ray_intersect_preliminary(ray)
        if not preliminary.is_valid():
            continue
        si = preliminary.compute_surface_interaction(ray)
        t[k], index[k] = preliminary.t, preliminary.prim_index
        place[k] = number.get(id(preliminary.shape), by_name[preliminary.shape.id()])
        normal[k], uv[k] = np.array(si.n).ravel(), np.array(preliminary.prim_uv).ravel()
    return t, place, index, normal, uv


def _nothing(count: int) -> tuple[Array, ...]:
    zeros = np.zeros(count, np.int64)
    return np.full(count, np.inf), zeros, zeros.copy(), np.zeros((count, 3)), np.zeros((count, 2))
