"""From the rank of a hit to the surface there: the stage between the intersector and the shader.

Distance and place are computed here, from the primitive, so they are the same whichever intersector found the hit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels import environment
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
    VERTICES,
    Needs,
)

OFFSET_ULPS = 256.0
"""New rays start this many machine epsilons of the largest coordinate away from the surface."""


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
def _on_triangle(o, d, face, world, smooth, real):
    """The point comes from the barycentric weights: it lies in the face however far the origin was."""
    vertices, faces = table(world, VERTICES, real), table(world, TRIANGLES, np.int32)
    ia, ib, ic = (
        3 * np.int64(fetch(faces, face)),
        3 * np.int64(fetch(faces, face + 1)),
        3 * np.int64(fetch(faces, face + 2)),
    )
    a, b, c = row3(vertices, ia), row3(vertices, ib), row3(vertices, ic)
    frame = ray_frame(d)
    sa, sb, sc = shear(frame, a - o), shear(frame, b - o), shear(frame, c - o)
    w = edge_weights(sa, sb, sc)
    whole = w.a + w.b + w.c
    inverse = real(1) / whole
    u, v = w.b * inverse, w.c * inverse
    stored = unit(triangle_normal(a, b, c))
    shading = stored
    if smooth:
        normals = table(world, VERTEX_NORMALS, real)
        bent = row3(normals, ia) * (w.a * inverse) + row3(normals, ib) * u + row3(normals, ic) * v
        square = dot(bent, bent)
        good = square > real(0)
        shading = select3(good, bent * (real(1) / np.sqrt(select(good, square, real(1)))), stored)
    t = (w.a * sa.z + w.b * sb.z + w.c * sc.z) / whole
    return Place(t, real(0), u, v, a * (w.a * inverse) + b * u + c * v, stored, shading)


@inline
def _on_sphere(o, d, row, world, real):
    """Solved in float64, and put back onto the sphere."""
    spheres = table(world, SPHERES, np.float64)
    center, radius = row3(spheres, row), fetch(spheres, row + 3)
    t = sphere_distance(wide(o), wide(d), center, radius)
    out = unit(wide(o) + wide(d) * t - center)
    normal = narrow(out, real)
    return Place(real(t), real(radius), real(0), real(0), narrow(center + out * radius, real), normal, normal)


@inline
def _on_plane(o, d, row, world, real):
    planes = table(world, PLANES, np.float64)
    anchor, upright = row3(planes, row), row3(planes, row + 3)
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
def _put_material(lanes, lane, materials, row, miss, needs, none):
    """Writes what the scene needs of the material; a miss reflects nothing."""
    if needs.diffuse:
        at.put3(lanes, at.KD, lane, select3(miss, none, row3(materials, row)))
    if needs.mirror:
        at.put3(lanes, at.KS, lane, select3(miss, none, row3(materials, row + 3)))
    if needs.refraction:
        at.put3(lanes, at.KT, lane, select3(miss, none, row3(materials, row + 6)))
    if needs.mirror or needs.refraction:
        put(lanes, at.IOR, lane, fetch(materials, row + 9))
        put(lanes, at.FRESNEL, lane, fetch(materials, row + 10))


@inline
def _listed_pdf(lanes, lane, world, light, kind, place, o, d, lit, needs, real):
    """The pdf with which the light sample would have chosen this hit; 0 where it is no listed light."""
    lights, n_lights = table(world, LIGHTS, real), real(count(world, N_LIGHTS))
    pdf, facing = real(0), abs(dot(d, place.stored))
    if needs.face_lights:
        listed = lit & (light >= 0) & (kind == TRIANGLE)
        area = fetch(lights, (light if listed else np.int64(0)) * LIGHT_REALS + 8)
        pdf = select(listed, place.t * place.t / (facing * area * n_lights), pdf)
    if needs.sphere_lights:
        listed = lit & (light >= 0) & (kind == SPHERE)
        row = (light if listed else np.int64(0)) * LIGHT_REALS
        radius = fetch(lights, row + 7)
        by_cone = cone(o, row3(lights, row + 1), radius).pdf
        by_area = place.t * place.t / (facing * real(4.0 * math.pi) * radius * radius)
        pdf = select(listed, select(by_cone > real(0), by_cone, by_area) / n_lights, pdf)
    return pdf


def _make(needs: Needs, tracing: Any, real: Any) -> Any:
    offset_scale = real(OFFSET_ULPS * float(np.finfo(tracing).eps))
    zero, one, infinite = real(0), real(1), real(np.inf)

    def surface(block, world):
        lanes = pointer(block, real)
        primitives, materials = table(world, PRIMITIVES, np.int32), table(world, MATERIALS, real)
        none = Vec3(zero, zero, zero)
        for lane in range(np.uint64(LANES)):
            rank, held = get_int(lanes, at.RANK, lane), get_int(lanes, at.HELD, lane)
            rank = held if held >= 0 else rank
            miss = rank < 0
            row = (np.int64(0) if miss else np.int64(rank)) * PRIMITIVE_INTS
            kind, index = fetch(primitives, row), np.int64(fetch(primitives, row + 1))
            material, light = np.int64(fetch(primitives, row + 2)), np.int64(fetch(primitives, row + 3))
            o, d = at.get3(lanes, at.ORIGIN, lane), at.get3(lanes, at.DIRECTION, lane)
            place = Place(infinite, zero, zero, zero, o, Vec3(zero, zero, one), Vec3(zero, zero, one))
            if needs.triangles:
                face = (index if kind == TRIANGLE else np.int64(0)) * 3
                place = _on_triangle(o, d, face, world, needs.smooth, real)
            if needs.spheres:
                this = kind == SPHERE
                place = _choose(
                    this, _on_sphere(o, d, (index if this else np.int64(0)) * SPHERE_REALS, world, real), place
                )
            if needs.planes:
                this = kind == PLANE
                place = _choose(
                    this, _on_plane(o, d, (index if this else np.int64(0)) * PLANE_REALS, world, real), place
                )
            # a hit that the primitive itself does not confirm (Embree claims some on slivers) is none
            miss = miss | (not (place.t < infinite))
            put_int(lanes, at.RANK, lane, np.int64(-1) if miss else np.int64(rank))
            front = _put_place(lanes, lane, place, o, d, miss, offset_scale)
            skin = material * MATERIAL_REALS
            _put_material(lanes, lane, materials, skin, miss, needs, none)
            emission, light_pdf = none, zero
            if needs.emission:
                lit = (not miss) & (front | (fetch(materials, skin + 14) > zero))
                emission = select3(lit, row3(materials, skin + 11), none)
                light_pdf = _listed_pdf(lanes, lane, world, light, kind, place, o, d, lit, needs, real)
            if needs.constant_sky:
                emission = select3(miss, row3(table(world, SKY_RADIANCE, real), 0), emission)
                sky_pdf = get(lanes, at.COS_PDF, lane) / real(count(world, N_LIGHTS))
                light_pdf = select(miss, sky_pdf, light_pdf)
            at.put3(lanes, at.EMISSION, lane, emission)
            put(lanes, at.LIGHT_PDF, lane, light_pdf)
        if needs.image_sky:
            _image_sky(lanes, world, real(count(world, N_LIGHTS)), real)

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


@cache
def stage(needs: Needs, tracing: Any, real: Any) -> Any:
    """The surface stage for a scene that holds `needs`; new rays start far enough away for the precision `tracing`."""
    return compile_stage(_make(needs, tracing, real))
