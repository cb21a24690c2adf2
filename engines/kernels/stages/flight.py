"""Flights of rays through media (docs/transport.md, "Media"), in scenes that have some.

Three stages: `flight` draws how far each ray flies before a medium scatters it, and ends the ray there, before closest hits are
sought; `arrival`, behind the surface stage, makes a vertex of the medium where no surface lies before; and `attenuation`
multiplies light samples by what their medium lets pass, where shadow rays cross no null lobes.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import EVERY_LANE, lanes_where
from engines.kernels.compile.records import address_of
from engines.kernels.compile.values import lowest_bit, select
from engines.kernels.lane import media
from engines.kernels.lane.vector import WHITE, Vec3, extent
from engines.kernels.layout import CAMERA_DIMENSIONS, LANES, MEDIUM, SURFACE, ray_batch, scene_table
from engines.kernels.rows import MediumRow
from engines.kernels.stages.hit_loads import lane_number, make_load_rows

_on_surfaces = lanes_where("==", SURFACE)
_SIGMA_T = tuple(lane_number("flight.sigma_t") + k for k in range(3))
_ALBEDO = tuple(lane_number("flight.albedo") + k for k in range(3))
_load_media = make_load_rows(
    "flight.medium", MediumRow, tuple(range(MediumRow.size)), (*_SIGMA_T, *_ALBEDO, lane_number("flight.g"))
)
_load_extinctions = make_load_rows("attenuation.medium", MediumRow, (0, 1, 2), _SIGMA_T)


@inline
def load_extinctions(rays, scene):
    """Copies what takes light from shadow rays to `flight.sigma_t`, which nobody reads after the shade stage."""
    _load_extinctions(rays, address_of(scene.media), EVERY_LANE)


@inline
def medium_beyond(rays, lane, scene, outside, medium):
    """The medium on a side of the surface that a lane has met; `medium`, the one before, where it is no boundary."""
    found = scene.medium_sides[2 * np.int64(rays.primitive[lane]) + (1 if outside else 0)]
    return medium if found < 0 else found


def _make_flight(real: Any) -> Any:
    zero, least = real(0), real(np.finfo(real).epsneg)

    def flight(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        offset_scale, camera_medium = real(scene.margins[0].offset), np.int32(scene.camera_medium)
        for lane in range(np.uint64(LANES)):
            begins = rays.dimension[lane] <= CAMERA_DIMENSIONS
            rays.flight.medium[lane] = select(begins, camera_medium, np.int32(rays.flight.medium[lane]))
            rays.flight.lead[lane] = select(begins, zero, rays.flight.lead[lane])
        _load_media(rays, address_of(scene.media), EVERY_LANE)
        for lane in range(np.uint64(LANES)):
            distance = media.flight(rays.flight.sigma_t[lane], rays.path.throughput[lane], rays.draw[0, lane], least)
            rays.flight.distance[lane] = distance
            # a surface just behind moves the vertex; twice as far, so that rounding hides none
            size = extent(rays.origin[lane])
            margin = offset_scale * select(size > distance, size, distance)
            end, t = distance + 2.0 * margin + rays.flight.lead[lane], rays.t[lane]
            rays.t[lane] = select(end < t, end, t)

    return flight


@inline
def _store_arrival(rays, lane, offset_scale, zero, hides):
    """What happens first on the lane's way: a vertex of the medium takes the place of the hit, where it lies before."""
    o, d, lead = rays.origin[lane], rays.direction[lane], rays.flight.lead[lane]
    flight, distance = rays.flight.distance[lane], rays.t[lane] + lead
    scattered = flight < distance
    way, sigma_t, throughput = select(scattered, flight, distance), rays.flight.sigma_t[lane], rays.path.throughput[lane]
    weight = media.flight_weight(sigma_t, throughput, way, scattered)
    rays.path.throughput[lane] = throughput * weight * select(scattered, rays.flight.albedo[lane], WHITE)
    size, none, hit = extent(o), Vec3(zero, zero, zero), rays.hit[lane]
    offset = offset_scale * select(size > flight, size, flight)
    nearest, half = distance - offset, 0.5 * distance
    nearest = select(nearest > half, nearest, half)
    place = select(flight > lead, flight, lead)
    point = o + d * (select(place < nearest, place, nearest) - lead)
    rays.hit.kind[lane] = select(scattered, np.int32(MEDIUM), np.int32(hit.kind))
    rays.hit.point[lane] = select(scattered, point, hit.point)
    rays.hit.normal[lane] = select(scattered, none, hit.normal)
    rays.hit.geometric_normal[lane] = select(scattered, none, hit.geometric_normal)
    rays.hit.offset[lane] = select(scattered, offset, hit.offset)
    rays.hit.emission[lane] = select(scattered, none, hit.emission)
    rays.hit.light_pdf[lane] = select(scattered, zero, hit.light_pdf)
    rays.primitive[lane] = select(scattered, np.int32(-1), np.int32(rays.primitive[lane]))
    rays.flight.near[lane] = rays.flight.medium[lane]
    rays.flight.far[lane] = rays.flight.medium[lane]
    if hides:
        rays.crossing.absent[lane] = rays.crossing.absent[lane] & (not scattered)


def _make_arrival(hides: bool, real: Any) -> Any:
    zero = real(0)

    def arrival(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        offset_scale = real(scene.margins[0].offset)
        for lane in range(np.uint64(LANES)):
            _store_arrival(rays, lane, offset_scale, zero, hides)
        hits = _on_surfaces(rays.hit.kind)
        while hits != 0:
            lane = np.uint64(lowest_bit(hits))
            hits &= hits - 1
            front, medium = rays.hit.front[lane], np.int32(rays.flight.medium[lane])
            rays.flight.near[lane] = medium_beyond(rays, lane, scene, front, medium)
            rays.flight.far[lane] = medium_beyond(rays, lane, scene, not front, medium)

    return arrival


def _make_attenuation(real: Any) -> Any:
    def attenuation(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        load_extinctions(rays, scene)
        for lane in range(np.uint64(LANES)):
            passed = media.transmittance(rays.flight.sigma_t[lane], rays.attenuation.distance[lane])
            rays.shadow.direct[lane] = rays.shadow.direct[lane] * passed

    return attenuation


@cache
def flight_stage(real: Any) -> Any:
    """The stage before closest hits."""
    return compile_stage(_make_flight(real))


@cache
def arrival_stage(hides: bool, real: Any) -> Any:
    """The stage behind that of surfaces; `hides`: some emitters hide from the camera."""
    return compile_stage(_make_arrival(hides, real))


@cache
def attenuation_stage(real: Any) -> Any:
    """The stage before shadow rays are traced that cross no null lobes."""
    return compile_stage(_make_attenuation(real))
