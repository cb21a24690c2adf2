"""The shade stage: each lane's state is read, the shader's step is called, and what it decides is written back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels import block as at
from engines.kernels.jit import LANES, compile_stage, fetch, get, get_int, pointer, put, put_int, select
from engines.kernels.materials import cosine_pdf
from engines.kernels.shaders import albedo, depth_map, no_shadows, path_tracer, whitted
from engines.kernels.shaders.step import Draws, Hit, Light, Material, Path
from engines.kernels.surface import OFFSET_ULPS
from engines.kernels.vector import Vec3, length, select3
from engines.kernels.world import N_LIGHTS, OPTIONS, Needs, count, table

SHADERS: Mapping[str, Any] = {
    "path_tracer": path_tracer, "whitted": whitted, "no_shadows": no_shadows, "depth_map": depth_map, "albedo": albedo,
}  # fmt: skip
SHADER_OPTIONS = 8
"""Numbers in the world's options that belong to the shader."""


def option_numbers(shader: Choice, bounds: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shader's options (8,) as numbers: max_depth, then what its step reads."""
    row = np.zeros(SHADER_OPTIONS)
    options = shader.options
    if shader.plugin is not None:
        row[: len(options)] = [float(value) for value in options.values()]
        return row
    row[0] = options.get("max_depth", 1)
    if shader.name == "path_tracer":
        row[1], row[2] = options["rr_depth"], path_tracer.DIRECT[options["direct"]]
    elif shader.name in ("whitted", "no_shadows"):
        row[1] = options["ambient"]
    elif shader.name == "depth_map":
        corner = bounds[1] if options["max_point"] is None else options["max_point"]
        row[3:6] = np.subtract(corner, center)  # NaN where there is no finite shape, and then the image is black
    return row


def _make(
    step: Any, needs: Needs, lit: bool, every: bool, branches: bool, shadows: bool, tracing: Any, real: Any
) -> Any:
    """`lit`: there are lights to sample; `every`: the step is called once for each of them."""
    zero, one, infinite = real(0), real(1), real(math.inf)
    reach = real(1 - OFFSET_ULPS * float(np.finfo(tracing).eps))
    branches = branches and needs.mirror and needs.refraction

    def shade(block, world):
        lanes = pointer(block, real)
        numbers = table(world, OPTIONS, np.float64)
        options = (
            real(fetch(numbers, 0)), real(fetch(numbers, 1)), real(fetch(numbers, 2)), real(fetch(numbers, 3)),
            real(fetch(numbers, 4)), real(fetch(numbers, 5)), real(fetch(numbers, 6)), real(fetch(numbers, 7)),
        )  # fmt: skip
        n_lights = count(world, N_LIGHTS)
        none = Vec3(zero, zero, zero)
        for lane in range(np.uint64(LANES)):
            # what the lane knows
            miss, front = get_int(lanes, at.MISS, lane) != 0, get_int(lanes, at.FRONT, lane) != 0
            working = get_int(lanes, at.ALIVE, lane) != 0
            point, normal = at.get3(lanes, at.POINT, lane), at.get3(lanes, at.NORMAL, lane)
            geometric, direction = at.get3(lanes, at.GEOMETRIC, lane), at.get3(lanes, at.DIRECTION, lane)
            hit = Hit(
                miss,
                get(lanes, at.T, lane),
                point,
                normal,
                geometric,
                direction,
                at.get3(lanes, at.ORIGIN, lane),
                front,
            )
            ior, fresnel = one, False
            if needs.mirror or needs.refraction:
                stored = get(lanes, at.IOR, lane)
                ior, fresnel = select(front, stored, one / stored), get(lanes, at.FRESNEL, lane) > zero
            material = Material(
                at.get3(lanes, at.KD, lane) if needs.diffuse else none,
                at.get3(lanes, at.KS, lane) if needs.mirror else none,
                at.get3(lanes, at.KT, lane) if needs.refraction else none,
                ior, fresnel, at.get3(lanes, at.EMISSION, lane), get(lanes, at.LIGHT_PDF, lane),
            )  # fmt: skip
            light = Light(direction, zero, none, zero)
            if lit:
                light = Light(
                    at.get3(lanes, at.TO_LIGHT, lane), get(lanes, at.DISTANCE, lane), at.get3(lanes, at.INCIDENT, lane),
                    get(lanes, at.SAMPLE_PDF, lane),
                )  # fmt: skip
            draws = Draws(
                get(lanes, at.DRAW + 3, lane), get(lanes, at.DRAW + 4, lane), get(lanes, at.DRAW + 5, lane),
                get(lanes, at.DRAW + 6, lane),
            )  # fmt: skip
            depth = get_int(lanes, at.DEPTH, lane)
            throughput = at.get3(lanes, at.THROUGHPUT, lane)
            path = Path(throughput, real(depth), get(lanes, at.PDF, lane))

            # what the shader makes of it
            result = step(hit, material, light, draws, path, options, needs)

            # what the lane does next
            turn, turns, first, stays = depth - depth, 1, True, False
            if every and lit:
                turn, turns = get_int(lanes, at.LIGHT, lane), n_lights
                first = turn == 0
                stays = working & (not miss) & (turn + 1 < turns)
                rank = get_int(lanes, at.RANK, lane)
                put_int(lanes, at.HELD, lane, select(stays, rank, turn - turn - 1))
                turn = select(stays, turn + 1, turn - turn)
                put_int(lanes, at.LIGHT, lane, turn)
            at.put3(
                lanes, at.RADIANCE, lane,
                at.get3(lanes, at.RADIANCE, lane) + select3(first & working, result.radiance, none),
            )  # fmt: skip
            offset = get(lanes, at.OFFSET, lane)
            near_side = point + geometric * offset
            at.put3(lanes, at.SHADOW_ORIGIN, lane, near_side)
            if lit:
                sent = working & ((result.direct.x > zero) | (result.direct.y > zero) | (result.direct.z > zero))
                at.put3(lanes, at.DIRECT, lane, select3(sent, result.direct, none))
                # aimed anew from where it starts: a parallel ray would meet a light seen from the side too early
                aim = light.wi * light.distance - geometric * offset
                way, endless = length(aim), light.distance == infinite
                at.put3(lanes, at.TO_LIGHT, lane, select3(endless, light.wi, aim * (one / way)))
                way = select(endless, infinite, way * reach - offset)
                put(lanes, at.SHADOW_T, lane, select(sent & shadows, way, -one))
            goes = working & result.alive & (not stays)
            put_int(lanes, at.LEFT, lane, get_int(lanes, at.RANK, lane))
            put_int(
                lanes,
                at.DONE,
                lane,
                select(working & (not result.alive) & (not stays), depth - depth + 1, depth - depth),
            )
            if branches:
                put_int(lanes, at.BRANCH, lane, select(goes & result.branch, depth - depth + 1, depth - depth))
                at.put3(lanes, at.BRANCH_DIRECTION, lane, result.branch_direction)
                at.put3(lanes, at.BRANCH_THROUGHPUT, lane, result.branch_throughput)
            origin = select3(result.through, point - geometric * offset, near_side)
            at.put3(lanes, at.ORIGIN, lane, select3(goes, origin, hit.origin))
            at.put3(lanes, at.DIRECTION, lane, select3(goes, result.direction, direction))
            at.put3(lanes, at.THROUGHPUT, lane, select3(goes, result.throughput, throughput))
            put(lanes, at.PDF, lane, select(goes, result.pdf, path.pdf))
            if needs.constant_sky:
                put(lanes, at.COS_PDF, lane, cosine_pdf(normal, result.direction))
            depth = select(goes, depth + 1, depth)
            put_int(lanes, at.DEPTH, lane, depth)
            put_int(lanes, at.DIMENSION, lane, 2 + 8 * ((depth - 1) * turns + turn))
            put(lanes, at.T, lane, select(goes, infinite, -one))

    return shade


@cache
def stage(name: str, needs: Needs, lit: bool, tracing: Any, real: Any) -> Any:
    """The shade stage of a built-in shader."""
    rule = SHADERS[name]
    shadows = name != "no_shadows"
    return compile_stage(_make(rule.step, needs, lit, rule.EVERY_LIGHT, rule.BRANCHES, shadows, tracing, real))


@cache
def plugin_stage(step: Any, every: bool, needs: Needs, lit: bool, tracing: Any, real: Any) -> Any:
    """The shade stage of a user's `@njit` step; `every`: it is called once for each light."""
    return compile_stage(_make(step, needs, lit, every, True, True, tracing, real), on_disk=False)
