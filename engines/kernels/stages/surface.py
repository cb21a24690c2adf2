"""From the rank of a hit to the surface there: the stage between the intersector and the shader.

Distance and place are computed here, from the primitive, so they are the same whichever intersector found the hit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from engines.kernels.lights import cone
from engines.kernels.shapes import edge_weights, plane_distance, ray_frame, shear, sphere_distance, triangle_normal
from engines.kernels.vector import Vec3, dot, extent, select3, unit
from engines.kernels.world import (
    LIGHT_REALS,
    LIGHTS,
    MARGINS,
    MATERIAL_REALS,
    MATERIALS,
    N_LIGHTS,
    PLANE,
    PLANE_REALS,
    PLANES,
    PRIMITIVE_INTS,
    PRIMITIVES,
    SKY,
    SKY_HEIGHT,
    SKY_PDF,
    SKY_RADIANCE,
    SKY_WIDTH,
    SPHERE,
    SPHERE_REALS,
    SPHERES,
    TRIANGLE,
    TRIANGLES,
    VERTEX_NORMALS,
    Needs,
    of_needs,
)

OFFSET_ULPS = 256.0
"""New rays start this many machine epsilons of the largest coordinate away from the surface."""


class Seen(NamedTuple):
    """What of a scene's needs the stage is compiled for; `trace` asks for the shapes alone."""

    triangles: bool
    spheres: bool
    planes: bool
    smooth: bool
    diffuse: bool
    mirror: bool
    refraction: bool
    emission: bool
    constant_sky: bool
    image_sky: bool
    face_lights: bool
    sphere_lights: bool


def margins(tracing: Any) -> NDArray[np.float64]:
    """For `World.bind`, by the precision in which rays are traced: how far off the surface new rays start, as a share of
    the largest coordinate there, and the share of the way to a light that a shadow ray covers."""
    share = OFFSET_ULPS * float(np.finfo(tracing).eps)
    return np.array([share, 1.0 - share])


@inline
def row3(values, at):
    return Vec3(fetch(values, at), fetch(values, at + 1), fetch(values, at + 2))


@inline
def wide(v):
    return Vec3(np.float64(v.x), np.float64(v.y), np.float64(v.z))


class Place(NamedTuple):
    """Where a ray hit: distance, barycentric weights, point, unit normal of the front side, and the interpolated one.

    `size` is the largest number that rounding has scaled with, besides coordinates and distance: a sphere's radius.
    """

    t: float
    size: float
    u: float
    v: float
    point: Vec3
    stored: Vec3
    shading: Vec3


@inline
def narrow(v, real):
    return Vec3(real(v.x), real(v.y), real(v.z))


@inline
def _fetch_triangle(lanes, lane, world, face, smooth, real):
    fetch_corners(lanes, lane, world, face, real)
    if smooth:
        faces = table(world, TRIANGLES, np.int32)
        for corner in range(3):
            vertex = 3 * np.int64(fetch(faces, 3 * face + corner))
            copy(lanes, at.CORNER_NORMAL + 3 * corner, lane, table(world, VERTEX_NORMALS, real), vertex, 3)


@inline
def _fetch_material(lanes, lane, world, material, needs, real):
    """What the scene needs of a material."""
    materials, row = table(world, MATERIALS, real), material * MATERIAL_REALS
    if needs.diffuse:
        copy(lanes, at.KD, lane, materials, row, 3)
    if needs.mirror:
        copy(lanes, at.KS, lane, materials, row + 3, 3)
    if needs.refraction:
        copy(lanes, at.KT, lane, materials, row + 6, 3)
    if needs.mirror or needs.refraction:
        put(lanes, at.IOR, lane, fetch(materials, row + 9))
        put(lanes, at.FRESNEL, lane, fetch(materials, row + 10))
    if needs.emission:
        copy(lanes, at.EMISSION, lane, materials, row + 11, 3)
        put(lanes, at.TWO_SIDED, lane, fetch(materials, row + 14))


@inline
def _fetch_light(lanes, lane, world, light, needs, real):
    """What the pdf of a primitive that belongs to a listed light depends on."""
    lights, row = table(world, LIGHTS, real), (light if light >= 0 else np.int64(0)) * LIGHT_REALS
    put_int(lanes, at.LIGHT_ROW, lane, light)
    if needs.face_lights:
        put(lanes, at.LIGHT_AREA, lane, fetch(lights, row + 8))
    if needs.sphere_lights:
        copy(lanes, at.LIGHT_PLACE, lane, lights, row + 1, 3)
        put(lanes, at.LIGHT_SIZE, lane, fetch(lights, row + 7))


@inline
def _fetch_hit(lanes, wide_lanes, world, needs, real):
    """All that the world knows of what the lanes hit."""
    primitives = table(world, PRIMITIVES, np.int32)
    for lane in range(np.uint64(LANES)):
        rank, held = get_int(lanes, at.RANK, lane), get_int(lanes, at.HELD, lane)
        rank = held if held >= 0 else rank
        put_int(lanes, at.RANK, lane, rank)
        rank = np.int64(0) if rank < 0 else np.int64(rank)
        row = rank * PRIMITIVE_INTS
        kind, index = np.int32(TRIANGLE), rank  # as it is where there are triangles alone: one cache miss less
        if needs.spheres or needs.planes:
            kind, index = fetch(primitives, row), np.int64(fetch(primitives, row + 1))
        put_int(lanes, at.KIND, lane, kind)
        if needs.triangles:
            _fetch_triangle(lanes, lane, world, index if kind == TRIANGLE else np.int64(0), needs.smooth, real)
        if needs.spheres and kind == SPHERE:
            copy(wide_lanes, 0, lane, table(world, SPHERES, np.float64), index * SPHERE_REALS, SPHERE_REALS)
        if needs.planes and kind == PLANE:
            copy(wide_lanes, 0, lane, table(world, PLANES, np.float64), index * PLANE_REALS, PLANE_REALS)
        _fetch_material(lanes, lane, world, np.int64(fetch(primitives, row + 2)), needs, real)
        if needs.face_lights or needs.sphere_lights:
            _fetch_light(lanes, lane, world, np.int64(fetch(primitives, row + 3)), needs, real)


@inline
def _on_triangle(lanes, lane, o, d, smooth):
    """The point comes from the barycentric weights: it lies in the face however far the origin was."""
    zero, one = const(0.0, d.x), const(1.0, d.x)
    a, b, c = at.get3(lanes, at.CORNER, lane), at.get3(lanes, at.CORNER + 3, lane), at.get3(lanes, at.CORNER + 6, lane)
    frame = ray_frame(d)
    sa, sb, sc = shear(frame, a - o), shear(frame, b - o), shear(frame, c - o)
    w = edge_weights(sa, sb, sc)
    whole = w.a + w.b + w.c
    inverse = one / whole
    u, v = w.b * inverse, w.c * inverse
    stored = unit(triangle_normal(a, b, c))
    shading = stored
    if smooth:
        na, nb = at.get3(lanes, at.CORNER_NORMAL, lane), at.get3(lanes, at.CORNER_NORMAL + 3, lane)
        bent = na * (w.a * inverse) + nb * u + at.get3(lanes, at.CORNER_NORMAL + 6, lane) * v
        square = dot(bent, bent)
        good = square > zero
        shading = select3(good, bent * (one / np.sqrt(select(good, square, one))), stored)
    t = (w.a * sa.z + w.b * sb.z + w.c * sc.z) / whole
    return Place(t, zero, u, v, a * (w.a * inverse) + b * u + c * v, stored, shading)


@inline
def _on_sphere(wide_lanes, lane, o, d, real):
    """Solved in float64, and put back onto the sphere."""
    center, radius = at.get3(wide_lanes, 0, lane), get(wide_lanes, 3, lane)
    t = sphere_distance(wide(o), wide(d), center, radius)
    out = unit(wide(o) + wide(d) * t - center)
    normal = narrow(out, real)
    return Place(real(t), real(radius), real(0), real(0), narrow(center + out * radius, real), normal, normal)


@inline
def _on_plane(wide_lanes, lane, o, d, real):
    anchor, upright = at.get3(wide_lanes, 0, lane), at.get3(wide_lanes, 3, lane)
    t = plane_distance(wide(o), wide(d), anchor, upright)
    spot = wide(o) + wide(d) * t
    spot = spot + upright * dot(upright, anchor - spot)
    normal = narrow(upright, real)
    return Place(real(t), real(0), real(0), real(0), narrow(spot, real), normal, normal)


@inline
def _choose(condition, yes, no):
    return Place(
        select(condition, yes.t, no.t),
        select(condition, yes.size, no.size),
        select(condition, yes.u, no.u),
        select(condition, yes.v, no.v),
        select3(condition, yes.point, no.point),
        select3(condition, yes.stored, no.stored),
        select3(condition, yes.shading, no.shading),
    )


@inline
def _put_place(lanes, lane, place, o, d, miss, offset_scale):
    """Writes the hit with its normals turned towards the viewer; returns whether the front was met."""
    front = dot(d, place.stored) < const(0.0, place.t)
    geometric = select3(front, place.stored, -place.stored)
    normal = select3(dot(place.shading, geometric) < const(0.0, place.t), -place.shading, place.shading)
    normal = select3(dot(d, normal) < const(0.0, place.t), normal, geometric)  # one that the viewer cannot see will not do
    reach, start = extent(place.point), extent(o)
    reach = select(start > reach, start, reach)
    reach = select(place.t > reach, place.t, reach)
    reach = select(place.size > reach, place.size, reach)
    put_int(lanes, at.MISS, lane, np.int32(1) if miss else np.int32(0))
    put_int(lanes, at.FRONT, lane, np.int32(1) if front else np.int32(0))
    put(lanes, at.T, lane, select(miss, const(math.inf, place.t), place.t))
    put(lanes, at.U, lane, place.u)
    put(lanes, at.V, lane, place.v)
    put(lanes, at.OFFSET, lane, reach * offset_scale)
    at.put3(lanes, at.POINT, lane, place.point)
    at.put3(lanes, at.GEOMETRIC, lane, geometric)
    at.put3(lanes, at.NORMAL, lane, normal)
    return front


@inline
def _darken(lanes, lane, miss, needs, none):
    """A miss reflects nothing."""
    if needs.diffuse:
        at.put3(lanes, at.KD, lane, select3(miss, none, at.get3(lanes, at.KD, lane)))
    if needs.mirror:
        at.put3(lanes, at.KS, lane, select3(miss, none, at.get3(lanes, at.KS, lane)))
    if needs.refraction:
        at.put3(lanes, at.KT, lane, select3(miss, none, at.get3(lanes, at.KT, lane)))


@inline
def _listed_pdf(lanes, lane, place, o, d, lit, n_lights, needs, real):
    """The pdf with which the light sample would have chosen this hit; 0 where it is no listed light."""
    pdf, facing, kind = real(0), abs(dot(d, place.stored)), get_int(lanes, at.KIND, lane)
    listed = lit & (get_int(lanes, at.LIGHT_ROW, lane) >= 0)
    if needs.face_lights:
        area = get(lanes, at.LIGHT_AREA, lane)
        pdf = select(listed & (kind == TRIANGLE), place.t * place.t / (facing * area * n_lights), pdf)
    if needs.sphere_lights:
        radius = get(lanes, at.LIGHT_SIZE, lane)
        by_cone = cone(o, at.get3(lanes, at.LIGHT_PLACE, lane), radius).pdf
        by_area = place.t * place.t / (facing * real(4.0 * math.pi) * radius * radius)
        pdf = select(listed & (kind == SPHERE), select(by_cone > real(0), by_cone, by_area) / n_lights, pdf)
    return pdf


@inline
def _place(lanes, wide_lanes, lane, o, d, needs, real):
    """Where the lane's ray met the primitive of its kind."""
    zero = real(0)
    place, kind = Place(real(np.inf), zero, zero, zero, o, d, d), get_int(lanes, at.KIND, lane)
    if needs.triangles:
        place = _on_triangle(lanes, lane, o, d, needs.smooth)
    if needs.spheres:
        place = _choose(kind == SPHERE, _on_sphere(wide_lanes, lane, o, d, real), place)
    if needs.planes:
        place = _choose(kind == PLANE, _on_plane(wide_lanes, lane, o, d, real), place)
    return place


def _make(needs: Seen, real: Any) -> Any:
    size = np.dtype(real).itemsize
    zero = real(0)

    def surface(block, world):
        lanes, wide_lanes = pointer(block, real), pointer(block + at.WIDE * LANES * size, np.float64)
        _fetch_hit(lanes, wide_lanes, world, needs, real)
        sky, n_lights = table(world, SKY_RADIANCE, real), real(count(world, N_LIGHTS))
        offset_scale = real(fetch(table(world, MARGINS, np.float64), 0))
        none = Vec3(zero, zero, zero)
        for lane in range(np.uint64(LANES)):
            o, d = at.get3(lanes, at.ORIGIN, lane), at.get3(lanes, at.DIRECTION, lane)
            place = _place(lanes, wide_lanes, lane, o, d, needs, real)
            # a hit that the primitive itself does not confirm (Embree claims some on slivers) is none
            rank = get_int(lanes, at.RANK, lane)
            miss = (rank < 0) | (not (place.t < real(np.inf)))
            put_int(lanes, at.RANK, lane, select(miss, rank - rank - 1, rank))
            front = _put_place(lanes, lane, place, o, d, miss, offset_scale)
            _darken(lanes, lane, miss, needs, none)
            emission, light_pdf = none, zero
            if needs.emission:
                lit = (not miss) & (front | (get(lanes, at.TWO_SIDED, lane) > zero))
                emission = select3(lit, at.get3(lanes, at.EMISSION, lane), none)
                light_pdf = _listed_pdf(lanes, lane, place, o, d, lit, n_lights, needs, real)
            if needs.constant_sky:
                emission = select3(miss, row3(sky, 0), emission)
                light_pdf = select(miss, get(lanes, at.COS_PDF, lane) / n_lights, light_pdf)
            at.put3(lanes, at.EMISSION, lane, emission)
            put(lanes, at.LIGHT_PDF, lane, light_pdf)
        if needs.image_sky:
            _image_sky(lanes, world, n_lights, real)

    return surface


@inline
def _image_sky(lanes, world, n_lights, real):
    """Emission of the rays that miss, from the environment's image: scalar code, in a loop of its own."""
    image, density = table(world, SKY, np.float64), table(world, SKY_PDF, np.float64)
    width, height = count(world, SKY_WIDTH), count(world, SKY_HEIGHT)
    for lane in range(np.uint64(LANES)):
        if get_int(lanes, at.MISS, lane) != 0:
            d = wide(at.get3(lanes, at.DIRECTION, lane))
            u, v = environment.direction_to_uv(d.x, d.y, d.z)
            sky = environment.radiance(image, width, height, u, v)
            at.put3(lanes, at.EMISSION, lane, Vec3(real(sky.x), real(sky.y), real(sky.z)))
            pdf = environment.pdf_solid_angle(density, width, height, u, v)
            put(lanes, at.LIGHT_PDF, lane, real(pdf) / n_lights)


def stage(needs: Needs, real: Any) -> Any:
    """The surface stage for a scene that holds `needs`."""
    return _stage(of_needs(Seen, needs), real)


def bare_stage(needs: Needs, real: Any) -> Any:
    """The same without materials and lights: where a ray met which shape, and the geometric normal there."""
    shapes = ("triangles", "spheres", "planes")
    return _stage(Seen(*(name in shapes and getattr(needs, name) for name in Seen._fields)), real)


@cache
def _stage(needs: Seen, real: Any) -> Any:
    return compile_stage(_make(needs, real))
