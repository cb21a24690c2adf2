"""The shade stage: each lane's state is read, the shader's step is called, and what it decides is written back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels import block as at
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
from engines.kernels.materials import cosine_pdf
from engines.kernels.shaders import albedo, depth_map, no_shadows, path_tracer, whitted
from engines.kernels.shaders.step import Draws, Hit, Light, Material, Path
from engines.kernels.vector import Vec3, length, select3
from engines.kernels.world import MARGINS, N_LIGHTS, OPTIONS, Needs, of_needs

SHADERS: Mapping[str, Any] = {
    "path_tracer": path_tracer, "whitted": whitted, "no_shadows": no_shadows, "depth_map": depth_map, "albedo": albedo,
}  # fmt: skip
PATH_TRACER, WHITTED, NO_SHADOWS, DEPTH_MAP, ALBEDO = range(5)
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


def wanted_draws(shader: Choice, needs: Needs) -> int:
    """A bit for each draw of a vertex that the shader may use in a scene that holds `needs`: two places on the light,
    the choice of light, the lobe, two for the direction, roulette."""
    if shader.plugin is not None:
        return 0b1111111
    light = 0b011 | (0b100 if needs.many_lights or needs.face_lights else 0)
    if shader.name != "path_tracer":
        return light
    lobe = 0b1000 if needs.mirror or needs.refraction else 0
    roulette = 0b1000000 if shader.options["rr_depth"] < shader.options["max_depth"] else 0
    return light | lobe | 0b110000 | roulette


class Reflecting(NamedTuple):
    """What of a scene's needs the stage of a built-in shader is compiled for."""

    diffuse: bool
    mirror: bool
    refraction: bool


class Traits(NamedTuple):
    """What else the stage is compiled for."""

    lit: bool
    """There are lights to sample."""
    every: bool
    """The step is called once for each light."""
    branches: bool
    """Two rays may follow from one hit."""
    shadows: bool


@inline
def _read_hit(lanes, lane):
    return Hit(
        get_int(lanes, at.MISS, lane) != 0, get(lanes, at.T, lane), at.get3(lanes, at.POINT, lane),
        at.get3(lanes, at.NORMAL, lane), at.get3(lanes, at.GEOMETRIC, lane), at.get3(lanes, at.DIRECTION, lane),
        at.get3(lanes, at.ORIGIN, lane), get_int(lanes, at.FRONT, lane) != 0,
    )  # fmt: skip


@inline
def _read_material(lanes, lane, front, needs, none):
    ior, fresnel = const(1.0, none.x), False
    if needs.mirror or needs.refraction:
        stored = get(lanes, at.IOR, lane)
        ior = select(front, stored, const(1.0, stored) / stored)
        fresnel = get(lanes, at.FRESNEL, lane) > const(0.0, stored)
    return Material(
        at.get3(lanes, at.KD, lane) if needs.diffuse else none,
        at.get3(lanes, at.KS, lane) if needs.mirror else none,
        at.get3(lanes, at.KT, lane) if needs.refraction else none,
        ior, fresnel, at.get3(lanes, at.EMISSION, lane), get(lanes, at.LIGHT_PDF, lane),
    )  # fmt: skip


@inline
def _read_light(lanes, lane, lit, none):
    if not lit:
        return Light(none, const(0.0, none.x), none, const(0.0, none.x))
    incident, pdf = at.get3(lanes, at.INCIDENT, lane), get(lanes, at.SAMPLE_PDF, lane)
    return Light(at.get3(lanes, at.TO_LIGHT, lane), get(lanes, at.DISTANCE, lane), incident, pdf)


@inline
def _read_draws(lanes, lane):
    lobe, roulette = get(lanes, at.DRAW + 3, lane), get(lanes, at.DRAW + 6, lane)
    return Draws(lobe, get(lanes, at.DRAW + 4, lane), get(lanes, at.DRAW + 5, lane), roulette)


@inline
def _next_turn(lanes, lane, working, miss, n_lights):
    """For shaders that visit every light: (this one's number, whether the lane stays for the next one)."""
    turn = get_int(lanes, at.LIGHT, lane)
    stays = working & (not miss) & (turn + 1 < n_lights)
    put_int(lanes, at.HELD, lane, select(stays, get_int(lanes, at.RANK, lane), turn - turn - 1))
    put_int(lanes, at.LIGHT, lane, select(stays, turn + 1, turn - turn))
    return turn, stays


@inline
def _put_shadow_ray(lanes, lane, hit, light, direct, offset, reach, working, shadows):
    """What waits for the shadow ray, and the ray: aimed anew from where it starts, since a parallel one would meet a
    light that is seen from the side too early."""
    zero, infinite = const(0.0, offset), const(math.inf, offset)
    sent = working & (not ((direct.x <= zero) & (direct.y <= zero) & (direct.z <= zero)))  # NaN is sent, to be counted
    at.put3(lanes, at.DIRECT, lane, select3(sent, direct, Vec3(zero, zero, zero)))
    aim = light.wi * light.distance - hit.geometric * offset
    way, endless = length(aim), light.distance == infinite
    at.put3(lanes, at.TO_LIGHT, lane, select3(endless, light.wi, aim * (const(1.0, way) / way)))
    way = select(endless, infinite, way * reach - offset)
    put(lanes, at.SHADOW_T, lane, select(sent & shadows, way, const(-1.0, way)))


@inline
def _put_next_ray(lanes, lane, hit, path, result, goes, offset, turns, turn, depth):
    """The ray that goes on, from the side of the surface on which it leaves."""
    step = select(result.through, -offset, offset)
    at.put3(lanes, at.ORIGIN, lane, select3(goes, hit.point + hit.geometric * step, hit.origin))
    at.put3(lanes, at.DIRECTION, lane, select3(goes, result.direction, hit.direction))
    at.put3(lanes, at.THROUGHPUT, lane, select3(goes, result.throughput, path.throughput))
    put(lanes, at.PDF, lane, select(goes, result.pdf, path.pdf))
    put(lanes, at.COS_PDF, lane, cosine_pdf(hit.normal, result.direction))
    put_int(lanes, at.LEFT, lane, get_int(lanes, at.RANK, lane))
    depth = select(goes, depth + 1, depth)
    put_int(lanes, at.DEPTH, lane, depth)
    put_int(lanes, at.DIMENSION, lane, 2 + 8 * ((depth - 1) * turns + turn))
    put(lanes, at.T, lane, select(goes, const(math.inf, offset), const(-1.0, offset)))


class State(NamedTuple):
    """One lane before its step."""

    working: bool
    depth: int
    hit: Hit
    material: Material
    light: Light
    draws: Draws
    path: Path


@inline
def _read(lanes, lane, needs, lit, real):
    none = Vec3(real(0), real(0), real(0))
    depth = get_int(lanes, at.DEPTH, lane)
    hit = _read_hit(lanes, lane)
    path = Path(at.get3(lanes, at.THROUGHPUT, lane), real(depth), get(lanes, at.PDF, lane))
    return State(
        get_int(lanes, at.ALIVE, lane) != 0, depth, hit, _read_material(lanes, lane, hit.front, needs, none),
        _read_light(lanes, lane, lit, none), _read_draws(lanes, lane), path,
    )  # fmt: skip


@inline
def _write(lanes, lane, before, result, n_lights, traits, reach, real):
    """What the lane does next."""
    working, depth, hit = before.working, before.depth, before.hit
    turn, turns, stays = depth - depth, 1, False
    if traits.every:
        turns = n_lights
        turn, stays = _next_turn(lanes, lane, working, hit.miss, n_lights)
    added = select3(working & (turn == 0), result.radiance, Vec3(real(0), real(0), real(0)))
    at.put3(lanes, at.RADIANCE, lane, at.get3(lanes, at.RADIANCE, lane) + added)
    offset = get(lanes, at.OFFSET, lane)
    at.put3(lanes, at.SHADOW_ORIGIN, lane, hit.point + hit.geometric * offset)
    if traits.lit:
        _put_shadow_ray(lanes, lane, hit, before.light, result.direct, offset, reach, working, traits.shadows)
    ends = working & (not stays)
    goes = ends & result.alive
    put_int(lanes, at.DONE, lane, select(ends & (not result.alive), depth - depth + 1, depth - depth))
    if traits.branches:
        put_int(lanes, at.BRANCH, lane, select(goes & result.branch, depth - depth + 1, depth - depth))
        at.put3(lanes, at.BRANCH_DIRECTION, lane, result.branch_direction)
        at.put3(lanes, at.BRANCH_THROUGHPUT, lane, result.branch_throughput)
    following = select(stays, turn + 1, turn - turn)
    _put_next_ray(lanes, lane, hit, before.path, result, goes, offset, turns, following, depth)


@inline
def _eight_options(world, real):
    numbers = table(world, OPTIONS, np.float64)
    return (
        real(fetch(numbers, 0)), real(fetch(numbers, 1)), real(fetch(numbers, 2)), real(fetch(numbers, 3)),
        real(fetch(numbers, 4)), real(fetch(numbers, 5)), real(fetch(numbers, 6)), real(fetch(numbers, 7)),
    )  # fmt: skip


def _make(code: int, needs: Reflecting, traits: Traits, real: Any) -> Any:
    def shade(block, world):
        lanes = pointer(block, real)
        options, n_lights = _eight_options(world, real), count(world, N_LIGHTS)
        reach = real(fetch(table(world, MARGINS, np.float64), 1))
        for lane in range(np.uint64(LANES)):
            now = _read(lanes, lane, needs, traits.lit, real)
            # steps by their global names: a stage that closes over a jitted function is not cached across processes
            if code == PATH_TRACER:
                result = path_tracer.step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            elif code == WHITTED:
                result = whitted.step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            elif code == NO_SHADOWS:
                result = no_shadows.step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            elif code == DEPTH_MAP:
                result = depth_map.step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            else:
                result = albedo.step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            _write(lanes, lane, now, result, n_lights, traits, reach, real)

    return shade


def _make_plugin(step: Any, needs: Needs, traits: Traits, real: Any) -> Any:
    def shade(block, world):
        lanes = pointer(block, real)
        options, n_lights = _eight_options(world, real), count(world, N_LIGHTS)
        reach = real(fetch(table(world, MARGINS, np.float64), 1))
        for lane in range(np.uint64(LANES)):
            now = _read(lanes, lane, needs, traits.lit, real)
            result = step(now.hit, now.material, now.light, now.draws, now.path, options, needs)
            _write(lanes, lane, now, result, n_lights, traits, reach, real)

    return shade


def traits(shader: Choice, needs: Needs, has_lights: bool) -> Traits:
    """What the stage of `shader` is compiled for in a scene that holds `needs`. Of a plugin nothing is known but whether it
    is called for every light, so it may branch and send shadow rays anywhere."""
    if shader.plugin is not None:
        return Traits(has_lights, has_lights and getattr(shader.plugin, "lights", "one") == "all", True, True)
    rule = SHADERS[shader.name]
    lit = has_lights and shader.name not in ("albedo", "depth_map")
    branches = rule.BRANCHES and needs.mirror and needs.refraction
    return Traits(lit, lit and rule.EVERY_LIGHT, branches, shader.name != "no_shadows")


def stage(name: str, jitted: Any, traits: Traits, needs: Needs, real: Any) -> Any:
    """The shade stage of the built-in shader `name`, or of a user's `jitted` step, which is told all needs."""
    if jitted is not None:
        return _plugin_stage(jitted, needs, traits, real)
    return _stage(name, of_needs(Reflecting, needs), traits, real)


@cache
def _stage(name: str, needs: Reflecting, traits: Traits, real: Any) -> Any:
    return compile_stage(_make(list(SHADERS).index(name), needs, traits, real))


@cache
def _plugin_stage(step: Any, needs: Needs, traits: Traits, real: Any) -> Any:
    return compile_stage(_make_plugin(step, needs, traits, real), on_disk=False)
