"""The light sample at a surface: which light, where on it, and what arrives (docs/transport.md)."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels import environment
from engines.kernels.fetching import copy, fetch_corners
from engines.kernels.jit import (
    LANES,
    compile_stage,
    const,
    count,
    fetch,
    get,
    get_int,
    inline,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.materials import cosine_direction, cosine_pdf
from engines.kernels.vector import Vec3, dot, length, select3, sin_cos_turn, tangents, unit
from engines.kernels.world import (
    CONSTANT_SKY,
    DIRECTIONAL_LIGHT,
    FACE_LIGHT,
    IMAGE_SKY,
    LIGHT_CDF,
    LIGHT_FACES,
    LIGHT_RANGE,
    LIGHT_REALS,
    LIGHTS,
    MATERIAL_REALS,
    MATERIALS,
    N_LIGHTS,
    POINT_LIGHT,
    PRIMITIVE_INTS,
    PRIMITIVES,
    SKY,
    SKY_COLUMNS,
    SKY_HEIGHT,
    SKY_PDF,
    SKY_ROWS,
    SKY_WIDTH,
    SPHERE_LIGHT,
    Needs,
    of_needs,
)


class Cone(NamedTuple):
    """The cone under which a sphere is seen: `pdf` per solid angle, 0 from inside; `k` is 1 - cos of its half angle."""

    pdf: float
    k: float
    axis: Vec3
    distance: float


@inline
def cone(p, center, radius):
    one, zero = const(1.0, radius), const(0.0, radius)
    to = center - p
    square = dot(to, to)
    outside = square > const(1.0001, radius) * radius * radius
    sin2 = select(outside, radius * radius / square, zero)
    k = sin2 / (one + np.sqrt(one - sin2))
    pdf = select(outside, one / (const(2.0 * math.pi, k) * select(outside, k, one)), zero)
    distance = np.sqrt(square)
    return Cone(pdf, k, to * (one / distance), distance)


class LightSample(NamedTuple):
    """`wi` unit, towards the light; `radiance` over pdf; `pdf` per solid angle, inf for delta lights, 0 for no sample."""

    wi: Vec3
    distance: float
    radiance: Vec3
    pdf: float


@inline
def sample_triangle(p, a, b, c, u0, u1):
    """Uniform in area: (direction, distance, signed cosine at the light towards p)."""
    one = const(1.0, u0)
    su = np.sqrt(u0)
    place = a * (one - su) + b * (su * (one - u1)) + c * (su * u1)
    to = place - p
    distance = length(to)
    wi = to * (one / distance)
    ab, ac = b - a, c - a
    normal = unit(Vec3(ab.y * ac.z - ab.z * ac.y, ab.z * ac.x - ab.x * ac.z, ab.x * ac.y - ab.y * ac.x))
    return wi, distance, -dot(wi, normal)


@inline
def sample_sphere(p, center, radius, emission, two_sided, u0, u1):
    """By the cone from outside, uniform in area from inside."""
    one, zero, two = const(1.0, u0), const(0.0, u0), const(2.0, u0)
    seen = cone(p, center, radius)
    sine, cosine = sin_cos_turn(u1)
    # the cone
    drop = u0 * seen.k
    cos = one - drop
    sin2 = drop * (two - drop)
    sin = np.sqrt(select(sin2 > zero, sin2, zero))
    t, b = tangents(seen.axis)
    wi = t * (sin * cosine) + b * (sin * sine) + seen.axis * cos
    inside = radius * radius - seen.distance * seen.distance * sin2
    near = seen.distance * cos - np.sqrt(select(inside > zero, inside, zero))
    # the whole surface
    z = one - two * u0
    ring = np.sqrt(select(one - z * z > zero, one - z * z, zero))
    out = Vec3(ring * cosine, ring * sine, z)
    to = center + out * radius - p
    far = length(to)
    wa = to * (one / far)
    facing = -dot(wa, out)
    area_pdf = far * far / (abs(facing) * const(4.0 * math.pi, u0) * radius * radius)
    by_cone = seen.pdf > zero
    pdf = select(by_cone, seen.pdf, area_pdf)
    lit = by_cone | (facing > zero) | (two_sided > zero)
    none = Vec3(zero, zero, zero)
    radiance = select3(lit, emission * (one / pdf), none)
    return LightSample(select3(by_cone, wi, wa), select(by_cone, near, far), radiance, pdf)


@inline
def _from_delta(kind, place, colour, falloff, p, needs, old):
    """Point and directional lights."""
    one, infinite = const(1.0, falloff), const(math.inf, falloff)
    result = old
    if needs.point:
        to = place - p
        square = dot(to, to)
        distance = np.sqrt(square)
        scale = one / select(falloff > const(0.0, falloff), square, one)
        spot = LightSample(to * (one / distance), distance, colour * scale, infinite)
        result = _choose_sample(kind == POINT_LIGHT, spot, result)
    if needs.directional:
        sun = LightSample(place, infinite, colour, infinite)
        result = _choose_sample(kind == DIRECTIONAL_LIGHT, sun, result)
    return result


@inline
def _from_sky(colour, normal, u0, u1):
    """A constant environment, by the cosine rule."""
    zero, one = const(0.0, u0), const(1.0, u0)
    wi = cosine_direction(normal, u0, u1)
    pdf = cosine_pdf(normal, wi)
    scale = select(pdf > zero, one / pdf, zero)
    return LightSample(wi, const(math.inf, u0), colour * scale, pdf)


@inline
def _from_face(lanes, lane, colour, two_sided, p, u0, u1):
    """A mesh's face, uniform in area, weighed by the area of the whole light."""
    zero, one = const(0.0, u0), const(1.0, u0)
    a, b, c = at.get3(lanes, at.CORNER, lane), at.get3(lanes, at.CORNER + 3, lane), at.get3(lanes, at.CORNER + 6, lane)
    wi, distance, facing = sample_triangle(p, a, b, c, u0, u1)
    lit = (facing > zero) | (two_sided > zero)
    weight = abs(facing) * get(lanes, at.LIGHT_AREA, lane) / (distance * distance)
    return LightSample(wi, distance, colour * select(lit, weight, zero), one / weight)


@inline
def _choose_sample(condition, yes, no):
    return LightSample(
        select3(condition, yes.wi, no.wi),
        select(condition, yes.distance, no.distance),
        select3(condition, yes.radiance, no.radiance),
        select(condition, yes.pdf, no.pdf),
    )


class Shining(NamedTuple):
    """What of a scene's needs the stage is compiled for."""

    point: bool
    directional: bool
    constant_sky: bool
    image_sky: bool
    face_lights: bool
    sphere_lights: bool
    many_lights: bool


def _make(needs: Shining, every: bool, real: Any) -> Any:
    zero, one, infinite = real(0), real(1), real(np.inf)

    def light(block, world):
        lanes = pointer(block, real)
        n = count(world, N_LIGHTS)
        _fetch_light(lanes, world, n, needs, every, real)
        share = one if every else one / real(n)
        for lane in range(np.uint64(LANES)):
            kind, size = get_int(lanes, at.KIND, lane), get(lanes, at.LIGHT_SIZE, lane)
            place, colour = at.get3(lanes, at.LIGHT_PLACE, lane), at.get3(lanes, at.LIGHT_COLOUR, lane)
            p, normal = at.get3(lanes, at.POINT, lane), at.get3(lanes, at.NORMAL, lane)
            u0, u1 = get(lanes, at.DRAW, lane), get(lanes, at.DRAW + 1, lane)
            sample = LightSample(Vec3(zero, zero, one), infinite, Vec3(zero, zero, zero), infinite)
            sample = _from_delta(kind, place, colour, size, p, needs, sample)
            if needs.constant_sky:
                sample = _choose_sample(kind == CONSTANT_SKY, _from_sky(colour, normal, u0, u1), sample)
            if needs.sphere_lights:
                ball = sample_sphere(p, place, size, colour, get(lanes, at.TWO_SIDED, lane), u0, u1)
                sample = _choose_sample(kind == SPHERE_LIGHT, ball, sample)
            if needs.face_lights:
                mesh = _from_face(lanes, lane, colour, get(lanes, at.TWO_SIDED, lane), p, u0, u1)
                sample = _choose_sample(kind == FACE_LIGHT, mesh, sample)
            at.put3(lanes, at.TO_LIGHT, lane, sample.wi)
            put(lanes, at.DISTANCE, lane, sample.distance)
            at.put3(lanes, at.INCIDENT, lane, sample.radiance * (one / share))
            put(lanes, at.SAMPLE_PDF, lane, sample.pdf * share)
        if needs.image_sky:
            _image_sky(lanes, world, share, real)

    return light


@inline
def _fetch_light(lanes, world, n, needs, every, real):
    """Which light each lane asks, for meshes which face, and all that the world knows of it: searches and plain loads, so
    in a loop of their own."""
    lights = table(world, LIGHTS, real)
    for lane in range(np.uint64(LANES)):
        rest = np.float64(get(lanes, at.DRAW + 2, lane))
        chosen = np.int64(0)
        if every:
            chosen = np.int64(get_int(lanes, at.LIGHT, lane))
        elif needs.many_lights:
            scaled = rest * n
            chosen = max(min(np.int64(scaled), n - 1), 0)  # a draw that is NaN must not leave the list
            rest = scaled - chosen
        row = chosen * LIGHT_REALS
        kind = np.int32(fetch(lights, row))
        put_int(lanes, at.KIND, lane, kind)
        copy(lanes, at.LIGHT_PLACE, lane, lights, row + 1, 3)
        copy(lanes, at.LIGHT_COLOUR, lane, lights, row + 4, 3)
        put(lanes, at.LIGHT_SIZE, lane, fetch(lights, row + 7))
        put(lanes, at.TWO_SIDED, lane, fetch(lights, row + 9))
        if needs.face_lights and kind == FACE_LIGHT:
            _fetch_face(lanes, lane, world, chosen, rest, real)


@inline
def _fetch_face(lanes, lane, world, light, rest, real):
    """A face of the mesh, chosen in proportion to its area."""
    ranges, ranks = table(world, LIGHT_RANGE, np.int32), table(world, LIGHT_FACES, np.int32)
    cdf = table(world, LIGHT_CDF, np.float64)
    start, size = np.int64(fetch(ranges, 2 * light)), np.int64(fetch(ranges, 2 * light + 1))
    rank = np.int64(fetch(ranks, start + environment.first_above(cdf, start, size, rest)))
    primitives, materials = table(world, PRIMITIVES, np.int32), table(world, MATERIALS, real)
    fetch_corners(lanes, lane, world, np.int64(fetch(primitives, rank * PRIMITIVE_INTS + 1)), real)
    skin = np.int64(fetch(primitives, rank * PRIMITIVE_INTS + 2)) * MATERIAL_REALS
    copy(lanes, at.LIGHT_COLOUR, lane, materials, skin + 11, 3)
    put(lanes, at.TWO_SIDED, lane, fetch(materials, skin + 14))
    put(lanes, at.LIGHT_AREA, lane, fetch(table(world, LIGHTS, real), light * LIGHT_REALS + 8))


@inline
def _image_sky(lanes, world, share, real):
    """Samples of the environment's image replace what the vector loop left in the lanes that chose it."""
    image, density = table(world, SKY, np.float64), table(world, SKY_PDF, np.float64)
    rows, columns = table(world, SKY_ROWS, np.float64), table(world, SKY_COLUMNS, np.float64)
    width, height = count(world, SKY_WIDTH), count(world, SKY_HEIGHT)
    for lane in range(np.uint64(LANES)):
        if get_int(lanes, at.KIND, lane) == IMAGE_SKY:
            u0, u1 = np.float64(get(lanes, at.DRAW, lane)), np.float64(get(lanes, at.DRAW + 1, lane))
            row = environment.first_above(rows, 0, height, u1)
            below = fetch(rows, row - 1) if row > 0 else 0.0
            v = (row + (u1 - below) / (fetch(rows, row) - below)) / height
            column = environment.first_above(columns, row * width, width, u0)
            below = fetch(columns, row * width + column - 1) if column > 0 else 0.0
            u = (column + (u0 - below) / (fetch(columns, row * width + column) - below)) / width
            w = environment.uv_to_direction(u, v)
            sky = environment.radiance(image, width, height, u, v)
            pdf = environment.pdf_solid_angle(density, width, height, u, v) * np.float64(share)
            scale = 1.0 / pdf if pdf > 0.0 else 0.0
            at.put3(lanes, at.TO_LIGHT, lane, Vec3(real(w.x), real(w.y), real(w.z)))
            put(lanes, at.DISTANCE, lane, real(np.inf))
            at.put3(lanes, at.INCIDENT, lane, Vec3(real(sky.x * scale), real(sky.y * scale), real(sky.z * scale)))
            put(lanes, at.SAMPLE_PDF, lane, real(pdf))


def stage(needs: Needs, every: bool, real: Any) -> Any:
    """The light stage; `every`: the lane's own light of all, instead of one chosen at random."""
    return _stage(of_needs(Shining, needs), every, real)


@cache
def _stage(needs: Shining, every: bool, real: Any) -> Any:
    return compile_stage(_make(needs, every, real))
