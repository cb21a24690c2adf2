"""Draws for the lanes, see docs/transport.md.

Quasi-random points are looked up in a table of whole numbers, one row a sample and one column a dimension, which the
renderer makes for the samples at hand; what differs between pixels (scrambling, rotation) is computed here.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.values import const
from engines.kernels.lane import sampler as lane_sampler
from engines.kernels.lane.sampler import dimension_key, mix, random_bits
from engines.kernels.layout import CAMERA_DIMENSIONS, LANES, SHADER_OPTIONS, VERTEX_DRAWS, ray_batch, scene_table
from engines.scene.support import option_numbers
from engines.sobol_numbers import DIRECTIONS

BITS = {
    "random": (lane_sampler.random, lane_sampler.random),
    "stratified": (lane_sampler.stratified, lane_sampler.stratified),
    "sobol": (lane_sampler.owen_scrambled, lane_sampler.unscrambled),
    "halton": (lane_sampler.rotated, lane_sampler.unscrambled),
}
"""Of each sampler the lane function, with scrambling and without."""
TABULATED = ("sobol", "halton")
SAMPLER_OPTION = SHADER_OPTIONS
"""Index in the scene's options of the sampler's number: a constant's value, the bits of a stratified grid."""

ALL_WANTED = (1 << VERTEX_DRAWS) - 1
LENS_DIMENSIONS = (0, 1, 9, 17)
"""Place in the pixel, place on the aperture: the eighth dimensions of the first two vertices, which no vertex uses."""
FLIGHT = 23
"""The dimension of a flight, counted from the first of the vertex at its end: an eighth one, too, which the lens leaves."""
SOBOL_DIMENSIONS = 64
HALTON_DIMENSIONS = 32


@inline
def _store_keys(rays, seed_key):
    """Writes each lane's pixel key; returns the largest dimension at which a lane starts."""
    last = np.int64(0)
    for lane in range(np.uint64(LANES)):
        rays.pixel_key[lane] = np.int32(mix(np.uint32(mix(np.uint32(rays.pixel[lane])) + seed_key)))
        dimension = np.int64(rays.dimension[lane])
        last = dimension if dimension > last else last
    return last


@inline
def _load_points(rays, points, stride, columns, first, draws):
    """Copies the lanes' points into their draws: plain loads, for a table read inside the loop that scrambles would
    keep it from becoming vector code where the machine has no fast gather."""
    for lane in range(np.uint64(LANES)):
        sample, dimension = np.int64(rays.sample[lane]), np.int64(rays.dimension[lane])
        row = (sample - first) * stride + (dimension if dimension < columns else columns)
        for k in range(draws):
            rays.draw_bits[k, lane] = np.int32(points[row + k])


@cache
def _to_real(bits_of: Any, real: Any) -> Any:
    """The function (rays, lane, k, seed_key, option) -> draw in [0, 1), from a sampler's bits."""
    shift, scale = (8, 2.0**-24) if real == np.float32 else (0, 2.0**-32)

    @inline
    def value(rays, lane, k, seed_key, option):
        pixel_key, sample = np.uint32(rays.pixel_key[lane]), np.uint32(rays.sample[lane])
        dimension, point = np.uint32(np.uint32(rays.dimension[lane]) + np.uint32(k)), np.uint32(rays.draw_bits[k, lane])
        bits = bits_of(pixel_key, dimension_key(pixel_key, dimension), sample, dimension, point, option)
        return real(bits >> np.uint32(shift)) * real(scale)

    return value


@cache
def _constant(real: Any) -> Any:
    @inline
    def value(rays, lane, k, seed_key, option):
        return real(option)

    return value


@cache
def _of_plugin(function: Any, options: tuple[float, ...], real: Any) -> Any:
    """The same of a user's function (pixel, sample, dimension, seed) -> float in [0, 1), given `options` if there are any."""
    drawn = function
    if options:

        @inline
        def drawn(pixel, sample, dimension, seed_key):
            return function(pixel, sample, dimension, seed_key, options)

    @inline
    def value(rays, lane, k, seed_key, option):
        dimension, sample, pixel = rays.dimension[lane], rays.sample[lane], rays.pixel[lane]
        u = const(drawn(np.uint32(pixel), np.uint32(sample), np.uint32(dimension + k), seed_key), option)  # in float64
        # draws become places in tables, so one that is not in [0, 1), NaN among them, must not get through
        u = u if u >= 0.0 else 0.0
        return real(min(u, 1.0 - 2.0**-24))

    return value


def _make(value: Any, tabulated: bool, draws: int, ahead: int, real: Any) -> Any:
    """A stage that fills draw 0 .. draws - 1 from the dimension on that lies `ahead` of `rays.dimension`, those that
    `scene.wanted_draws` has a bit for."""
    shift, scale = (8, 2.0**-24) if real == np.float32 else (0, 2.0**-32)

    def draw(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        wanted = scene.wanted_draws if draws == VERTEX_DRAWS else np.int64(ALL_WANTED)
        option, seed_key = scene.options[SAMPLER_OPTION], np.uint32(scene.seed_key)
        stride = scene.points_stride
        columns = stride - VERTEX_DRAWS
        if ahead:
            _move(rays, ahead)
        last = _store_keys(rays, seed_key)
        if tabulated:
            _load_points(rays, scene.sample_points, stride, columns, scene.first_sample, draws)
        for k in range(draws):
            if (wanted >> k) & 1 == 0:
                continue
            # beyond the columns of the table there are random numbers; few paths get that far
            beyond = tabulated and last + k >= columns
            for lane in range(np.uint64(LANES)):
                rays.draw[k, lane] = value(rays, lane, k, seed_key, option)
            if beyond:
                _random_beyond(rays, k, columns, np.uint32(shift), real(scale), real)
        if ahead:
            _move(rays, -ahead)

    return draw


@inline
def _move(rays, dimensions):
    for lane in range(np.uint64(LANES)):
        rays.dimension[lane] = rays.dimension[lane] + dimensions


@inline
def _random_beyond(rays, k, columns, shift, scale, real):
    for lane in range(np.uint64(LANES)):
        dimension = rays.dimension[lane] + k
        key = dimension_key(np.uint32(rays.pixel_key[lane]), np.uint32(dimension))
        bits = random_bits(key, np.uint32(rays.sample[lane]))
        if dimension >= columns:
            rays.draw[k, lane] = real(bits >> shift) * scale


def _make_for_lens(value: Any, tabulated: bool, real: Any) -> Any:
    """A stage that fills draw 0 .. 3 from the dimensions `LENS_DIMENSIONS` of rays that begin; every table has these."""

    def draw(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        option, seed_key = scene.options[SAMPLER_OPTION], np.uint32(scene.seed_key)
        points, stride, first_sample = scene.sample_points, scene.points_stride, scene.first_sample
        _store_keys(rays, seed_key)
        for k in range(len(LENS_DIMENSIONS)):
            dimension = LENS_DIMENSIONS[k]
            for lane in range(np.uint64(LANES)):
                rays.dimension[lane] = dimension - k  # from which draw k is counted
                if tabulated:
                    row = (np.int64(rays.sample[lane]) - first_sample) * stride
                    rays.draw_bits[k, lane] = np.int32(points[row + dimension])
            for lane in range(np.uint64(LANES)):
                rays.draw[k, lane] = value(rays, lane, k, seed_key, option)

    return draw


def _value_of(sampler: Choice, real: Any) -> Any:
    """The function (rays, lane, k, seed_key, option) -> draw in [0, 1) of a sampler."""
    if sampler.plugin is not None:
        return _of_plugin(sampler.plugin.jitted, tuple(option_numbers(sampler.options)), real)
    if sampler.name == "constant":
        return _constant(real)
    scrambled, plain = BITS[sampler.name]
    return _to_real(plain if sampler.options.get("scramble") == "none" else scrambled, real)


def _is_tabulated(sampler: Choice) -> bool:
    return sampler.plugin is None and sampler.name in TABULATED


def stages(sampler: Choice, real: Any, lens: bool = False) -> tuple[Any, Any]:
    """(draws for the camera, draws for a vertex) of a sampler; `lens`: the camera is one."""
    value, tabulated = _value_of(sampler, real), _is_tabulated(sampler)
    camera = _lens_stage(value, tabulated, real) if lens else _stage(value, tabulated, CAMERA_DIMENSIONS, 0, real)
    return camera, _stage(value, tabulated, VERTEX_DRAWS, 0, real)


def flight_stage(sampler: Choice, real: Any) -> Any:
    """The draw of a ray's flight through a medium, draw 0."""
    return _stage(_value_of(sampler, real), _is_tabulated(sampler), 1, FLIGHT, real)


@cache
def _lens_stage(value: Any, tabulated: bool, real: Any) -> Any:
    return compile_stage(_make_for_lens(value, tabulated, real))


@cache
def _stage(value: Any, tabulated: bool, draws: int, ahead: int, real: Any) -> Any:
    return compile_stage(_make(value, tabulated, draws, ahead, real))


def seed_key(seed: int) -> int:
    """The 32-bit key of a seed."""
    return _mix_int((_mix_int(seed & 0xFFFFFFFF) + (seed >> 32)) & 0xFFFFFFFF)


def _mix_int(x: int) -> int:
    x ^= x >> 16
    x = x * 0x7FEB352D & 0xFFFFFFFF
    x ^= x >> 15
    x = x * 0x846CA68B & 0xFFFFFFFF
    return x ^ x >> 16


def points(sampler: Choice, first: int, last: int) -> NDArray[np.uint32]:
    """The table (samples first .. last - 1, dimensions) that the stage of `sampler` reads; empty where it reads
    none."""
    index = np.arange(first, last, dtype=np.uint64)
    if sampler.plugin is not None:
        return np.zeros((1, 1), np.uint32)
    if sampler.name == "sobol":
        return _sobol(index, reverse=sampler.options["scramble"] != "none")
    if sampler.name == "halton":
        return np.column_stack([_radical_inverse(index, base) for base in _primes(HALTON_DIMENSIONS)])
    return np.zeros((1, 1), np.uint32)


def _sobol(index: NDArray[np.uint64], reverse: bool) -> NDArray[np.uint32]:
    """Sobol points of `index` (n,), (n, 64); bit-reversed for the scrambler, which starts by reversing."""
    numbers = np.asarray(DIRECTIONS, np.uint32)[:SOBOL_DIMENSIONS]
    result = np.zeros((len(index), SOBOL_DIMENSIONS), np.uint32)
    for bit in range(int(index[-1]).bit_length() if len(index) else 0):
        odd = ((index >> np.uint64(bit)) & np.uint64(1)).astype(bool)
        result[odd] ^= numbers[:, bit]
    if not reverse:
        return result
    bytes_reversed = np.packbits(np.unpackbits(result.view(np.uint8).reshape(-1, 4), axis=1, bitorder="little"), axis=1)
    return bytes_reversed.view(">u4").astype(np.uint32).reshape(result.shape)


def _radical_inverse(index: NDArray[np.uint64], base: int) -> NDArray[np.uint32]:
    """floor(2^32 phi_base(index)), phi as a quotient of whole numbers below 2^53."""
    rest, digits, whole = index.astype(np.int64), np.zeros(len(index), np.int64), np.ones(len(index), np.int64)
    while rest.any():
        live = rest > 0
        digits = np.where(live, digits * base + rest % base, digits)
        whole = np.where(live, whole * base, whole)
        rest //= base
    return np.floor(digits / whole * 2.0**32).astype(np.uint32)


def _primes(n: int) -> list[int]:
    found: list[int] = []
    candidate = 2
    while len(found) < n:
        if all(candidate % p for p in found):
            found.append(candidate)
        candidate += 1
    return found
