"""From the rank of a hit to the surface there: the stage between the intersector and the shader.

Distance and place are computed here, from the primitive, so they are the same whichever intersector found the hit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from engines.kernels import block as at
from engines.kernels import environment
from engines.kernels.jit import (
    LANES,
    compile_stage,
    const,
    fetch,
    get,
    get_int,
    inline,
    pointer,
    put,
    put_int,
    select,
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
    count,
    table,
)

OFFSET_ULPS = 256.0
"""New rays start this many machine epsilons of the largest coordinate away from the surface."""


@inline
def row3(values, at):
    return Vec3(fetch(values, at), fetch(values, at + 1), fetch(values, at + 2))


@inline
def wide(v):
    return Vec3(np.float64(v.x), np.float64(v.y), np.float64(v.z))


def _make(needs: Needs, tracing: Any, real: Any) -> Any:
    offset_scale = real(OFFSET_ULPS * float(np.finfo(tracing).eps))
    zero, one, infinite = real(0), real(1), real(np.inf)
    specular = needs.mirror or needs.refraction

    def surface(block, world):
        lanes = pointer(block, real)
        primitives, materials = table(world, PRIMITIVES, np.int32), table(world, MATERIALS, real)
        vertices, faces = table(world, VERTICES, real), table(world, TRIANGLES, np.int32)
        normals = table(world, VERTEX_NORMALS, real)
        spheres, planes = table(world, SPHERES, np.float64), table(world, PLANES, np.float64)
        lights = table(world, LIGHTS, real)
        n_lights = real(count(world, N_LIGHTS))
        for lane in range(np.uint64(LANES)):
            rank = get_int(lanes, at.RANK, lane)
            held = get_int(lanes, at.HELD, lane)
            rank = held if held >= 0 else rank
            miss = rank < 0
            place = np.int64(0) if miss else np.int64(rank)
            kind = fetch(primitives, place * PRIMITIVE_INTS)
            index = np.int64(fetch(primitives, place * PRIMITIVE_INTS + 1))
            material = np.int64(fetch(primitives, place * PRIMITIVE_INTS + 2)) * MATERIAL_REALS
            light = np.int64(fetch(primitives, place * PRIMITIVE_INTS + 3))
            o, d = at.get3(lanes, at.ORIGIN, lane), at.get3(lanes, at.DIRECTION, lane)
            t, u, v = infinite, zero, zero
            point, stored, shading = o, Vec3(zero, zero, one), Vec3(zero, zero, one)

            # where, and which way it faces
            if needs.triangles:
                face = (index if kind == TRIANGLE else np.int64(0)) * 3
                ia, ib, ic = 3 * np.int64(fetch(faces, face)), 3 * np.int64(fetch(faces, face + 1)), 3 * np.int64(fetch(faces, face + 2))
                a, b, c = row3(vertices, ia), row3(vertices, ib), row3(vertices, ic)
                frame = ray_frame(d)
                sa, sb, sc = shear(frame, a - o), shear(frame, b - o), shear(frame, c - o)
                w = edge_weights(sa, sb, sc)
                inverse = one / (w.a + w.b + w.c)
                t = (w.a * sa.z + w.b * sb.z + w.c * sc.z) / (w.a + w.b + w.c)
                u, v = w.b * inverse, w.c * inverse
                point = a * (w.a * inverse) + b * u + c * v
                stored = unit(triangle_normal(a, b, c))
                shading = stored
                if needs.smooth:
                    bent = row3(normals, ia) * (w.a * inverse) + row3(normals, ib) * u + row3(normals, ic) * v
                    square = dot(bent, bent)
                    shading = select3(square > zero, bent * (one / np.sqrt(select(square > zero, square, one))), stored)
            if needs.spheres:
                this = kind == SPHERE
                row = (index if this else np.int64(0)) * SPHERE_REALS
                center, radius = row3(spheres, row), fetch(spheres, row + 3)
                o64, d64 = wide(o), wide(d)
                far = sphere_distance(o64, d64, center, radius)
                out = unit(o64 + d64 * far - center)
                spot = center + out * radius
                t = select(this, real(far), t)
                u, v = select(this, zero, u), select(this, zero, v)
                point = select3(this, Vec3(real(spot.x), real(spot.y), real(spot.z)), point)
                stored = select3(this, Vec3(real(out.x), real(out.y), real(out.z)), stored)
                shading = select3(this, stored, shading)
            if needs.planes:
                this = kind == PLANE
                row = (index if this else np.int64(0)) * PLANE_REALS
                anchor, upright = row3(planes, row), row3(planes, row + 3)
                o64, d64 = wide(o), wide(d)
                far = plane_distance(o64, d64, anchor, upright)
                spot = o64 + d64 * far
                spot = spot + upright * dot(upright, anchor - spot)
                t = select(this, real(far), t)
                u, v = select(this, zero, u), select(this, zero, v)
                point = select3(this, Vec3(real(spot.x), real(spot.y), real(spot.z)), point)
                stored = select3(this, Vec3(real(upright.x), real(upright.y), real(upright.z)), stored)
                shading = select3(this, stored, shading)
            front = dot(d, stored) < zero
            geometric = select3(front, stored, -stored)
            normal = select3(dot(shading, geometric) < zero, -shading, shading)
            reach = extent(point)
            start = extent(o)
            reach = select(start > reach, start, reach)
            reach = select(t > reach, t, reach)
            put_int(lanes, at.RANK, lane, rank)
            put_int(lanes, at.MISS, lane, np.int32(1) if miss else np.int32(0))
            put_int(lanes, at.FRONT, lane, np.int32(1) if front else np.int32(0))
            put(lanes, at.T, lane, select(miss, infinite, t))
            put(lanes, at.U, lane, u)
            put(lanes, at.V, lane, v)
            put(lanes, at.OFFSET, lane, reach * offset_scale)
            at.put3(lanes, at.POINT, lane, point)
            at.put3(lanes, at.GEOMETRIC, lane, geometric)
            at.put3(lanes, at.NORMAL, lane, normal)

            # what it is made of
            none = Vec3(zero, zero, zero)
            if needs.diffuse:
                at.put3(lanes, at.KD, lane, select3(miss, none, row3(materials, material)))
            if needs.mirror:
                at.put3(lanes, at.KS, lane, select3(miss, none, row3(materials, material + 3)))
            if needs.refraction:
                at.put3(lanes, at.KT, lane, select3(miss, none, row3(materials, material + 6)))
            if specular:
                put(lanes, at.IOR, lane, fetch(materials, material + 9))
                put(lanes, at.FRESNEL, lane, fetch(materials, material + 10))
            emission, light_pdf, lit = none, zero, False
            if needs.emission:
                lit = (~miss) & (front | (fetch(materials, material + 14) > zero))
                emission = select3(lit, row3(materials, material + 11), none)
            if needs.face_lights:
                listed = lit & (light >= 0) & (kind == TRIANGLE)
                area = fetch(lights, (light if listed else np.int64(0)) * LIGHT_REALS + 8)
                facing = abs(dot(d, stored))
                light_pdf = select(listed, t * t / (facing * area * n_lights), light_pdf)
            if needs.sphere_lights:
                listed = lit & (light >= 0) & (kind == SPHERE)
                row = (light if listed else np.int64(0)) * LIGHT_REALS
                pdf = cone(o, row3(lights, row + 1), fetch(lights, row + 7)).pdf
                r = fetch(lights, row + 7)
                by_area = t * t / (abs(dot(d, stored)) * const(4.0 * math.pi, t) * r * r)
                pdf = select(pdf > zero, pdf, by_area)
                light_pdf = select(listed, pdf / n_lights, light_pdf)
            if needs.constant_sky:
                sky = table(world, SKY_RADIANCE, real)
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


@cache
def stage(needs: Needs, tracing: Any, real: Any) -> Any:
    """The surface stage for a scene that holds `needs`; new rays start far enough away for the precision `tracing`."""
    return compile_stage(_make(needs, tracing, real))
