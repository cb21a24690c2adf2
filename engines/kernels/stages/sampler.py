"""Draws for the lanes: pure functions of (pixel, sample, dimension, seed), see docs/transport.md.

Quasi-random points are looked up in a table of whole numbers, one row a sample and one column a dimension, which the
renderer makes for the samples at hand; what differs between pixels (scrambling, rotation) is computed here.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels import block as at
from engines.kernels.jit import LANES, compile_stage, const, count, fetch, get_int, inline, pointer, put, put_int, table
from engines.kernels.world import FIRST_SAMPLE, OPTIONS, POINTS, POINTS_STRIDE, SEED_KEY, WANTED
from engines.sobol_numbers import DIRECTIONS

RANDOM, CONSTANT, SOBOL, HALTON, STRATIFIED = range(5)
CODES = {"random": RANDOM, "constant": CONSTANT, "sobol": SOBOL, "halton": HALTON, "stratified": STRATIFIED}
SAMPLER_OPTION = 8
"""Index in the world's options of the sampler's number: a constant's value, the bits of a stratified grid."""

GOLDEN = 0x9E3779B9
DRAWS = 7
ALL_WANTED = (1 << DRAWS) - 1
SOBOL_DIMENSIONS = 64
HALTON_DIMENSIONS = 32


@inline
def mix(x):
    """Wellons' lowbias32, a bijection of 32-bit integers without visible structure."""
    x = np.uint32(x ^ (x >> np.uint32(16)))
    x = np.uint32(x * np.uint32(0x7FEB352D))
    x = np.uint32(x ^ (x >> np.uint32(15)))
    x = np.uint32(x * np.uint32(0x846CA68B))
    return np.uint32(x ^ (x >> np.uint32(16)))


@inline
def dimension_key(pixel_key, dimension):
    return mix(np.uint32(pixel_key + np.uint32(dimension * np.uint32(GOLDEN))))


@inline
def random_bits(key, sample):
    return mix(np.uint32(key + np.uint32(sample * np.uint32(GOLDEN))))


@inline
def reverse_bits(x):
    x = np.uint32(((x >> np.uint32(1)) & np.uint32(0x55555555)) | ((x & np.uint32(0x55555555)) << np.uint32(1)))
    x = np.uint32(((x >> np.uint32(2)) & np.uint32(0x33333333)) | ((x & np.uint32(0x33333333)) << np.uint32(2)))
    x = np.uint32(((x >> np.uint32(4)) & np.uint32(0x0F0F0F0F)) | ((x & np.uint32(0x0F0F0F0F)) << np.uint32(4)))
    x = np.uint32(((x >> np.uint32(8)) & np.uint32(0x00FF00FF)) | ((x & np.uint32(0x00FF00FF)) << np.uint32(8)))
    return np.uint32((x >> np.uint32(16)) | (x << np.uint32(16)))


@inline
def owen_scramble(reversed_x, key):
    """Nested uniform scrambling by a hash (Laine and Karras 2011, Vegdahl's constants) of bit-reversed input."""
    y = np.uint32(reversed_x ^ np.uint32(reversed_x * np.uint32(0x3D20ADEA)))
    y = np.uint32(y + key)
    y = np.uint32(y * np.uint32((key >> np.uint32(16)) | np.uint32(1)))
    y = np.uint32(y ^ np.uint32(y * np.uint32(0x05526C56)))
    y = np.uint32(y ^ np.uint32(y * np.uint32(0x53A22864)))
    return reverse_bits(y)


@inline
def permute(i, bits, key):
    """A keyed bijection of [0, 2^bits)."""
    one = np.uint32(1)
    mask = np.uint32(np.uint32(one << bits) - one)
    half = np.uint32(bits >> one)
    i = np.uint32((i ^ key) & mask)
    i = np.uint32(np.uint32(i * np.uint32(0x7FEB352D)) & mask)
    i = np.uint32(i ^ (i >> half))
    i = np.uint32(np.uint32(i + (key >> np.uint32(8))) & mask)
    i = np.uint32(np.uint32(i * np.uint32(0x846CA68B)) & mask)
    i = np.uint32(i ^ (i >> half))
    i = np.uint32((i ^ (key >> np.uint32(16))) & mask)
    i = np.uint32(np.uint32(i * np.uint32(0x9E3779B1)) & mask)
    return np.uint32(i ^ (i >> half))


@inline
def stratified_bits(pixel_key, key, sample, dimension, side_bits):
    """A jittered place in the grid that dimensions 2p and 2p + 1 share, cells in random order."""
    m = np.uint32(side_bits)
    bits = np.uint32(m + m)
    even = np.uint32(dimension & np.uint32(0xFFFFFFFE))
    order_key = mix(
        np.uint32(dimension_key(pixel_key, even) + np.uint32(np.uint32(sample >> bits) * np.uint32(GOLDEN)))
    )
    one = np.uint32(1)
    cell = permute(np.uint32(sample & np.uint32(np.uint32(one << bits) - one)), bits, order_key)
    odd = np.uint32(dimension & one)
    cell = np.uint32((cell >> np.uint32(odd * m)) & np.uint32(np.uint32(one << m) - one))
    return np.uint32(np.uint32(cell << np.uint32(np.uint32(32) - m)) | (random_bits(key, sample) >> m))


@inline
def _keys(lanes, seed_key):
    """Writes each lane's pixel key; returns the largest dimension at which a lane starts."""
    last = np.int64(0)
    for lane in range(np.uint64(LANES)):
        key = mix(np.uint32(mix(np.uint32(get_int(lanes, at.PIXEL, lane))) + seed_key))
        put_int(lanes, at.PIXEL_KEY, lane, np.int32(key))
        dimension = np.int64(get_int(lanes, at.DIMENSION, lane))
        last = dimension if dimension > last else last
    return last


@inline
def _fetch_points(lanes, points, stride, columns, first, draws):
    """Copies the lanes' points into their draws: plain loads, for a table read inside the loop that scrambles would keep
    it from becoming vector code where the machine has no fast gather."""
    for lane in range(np.uint64(LANES)):
        sample, dimension = np.int64(get_int(lanes, at.SAMPLE, lane)), np.int64(get_int(lanes, at.DIMENSION, lane))
        row = (sample - first) * stride + (dimension if dimension < columns else columns)
        for k in range(draws):
            put_int(lanes, at.DRAW + k, lane, np.int32(fetch(points, row + k)))


def _make(kind: int, scrambled: bool, draws: int, real: Any) -> Any:
    """A stage that fills DRAW .. DRAW + draws - 1 from dimension DIMENSION on, those that WANTED has a bit for."""
    shift, scale = (8, 2.0**-24) if real == np.float32 else (0, 2.0**-32)

    def draw(block, world):
        lanes = pointer(block, real)
        wanted = count(world, WANTED) if draws == DRAWS else np.int64(ALL_WANTED)
        option = fetch(table(world, OPTIONS, np.float64), SAMPLER_OPTION)
        columns = count(world, POINTS_STRIDE) - DRAWS
        last = _keys(lanes, np.uint32(count(world, SEED_KEY)))
        if kind in (SOBOL, HALTON):
            points = table(world, POINTS, np.uint32)
            _fetch_points(lanes, points, columns + DRAWS, columns, count(world, FIRST_SAMPLE), draws)
        for k in range(draws):
            if (wanted >> k) & 1 == 0:
                continue
            # beyond the columns of the table there are random numbers; few paths get that far
            beyond = kind in (SOBOL, HALTON) and last + k >= columns
            for lane in range(np.uint64(LANES)):
                if kind == CONSTANT:
                    put(lanes, at.DRAW + k, lane, real(option))
                    continue
                pixel_key = np.uint32(get_int(lanes, at.PIXEL_KEY, lane))
                dimension = np.uint32(np.uint32(get_int(lanes, at.DIMENSION, lane)) + np.uint32(k))
                key = dimension_key(pixel_key, dimension)
                if kind in (SOBOL, HALTON):
                    bits = np.uint32(get_int(lanes, at.DRAW + k, lane))
                    if kind == SOBOL:
                        bits = owen_scramble(bits, key) if scrambled else bits
                    else:
                        bits = np.uint32(bits + key) if scrambled else bits
                    put(lanes, at.DRAW + k, lane, real(bits >> np.uint32(shift)) * real(scale))
                else:
                    sample = np.uint32(get_int(lanes, at.SAMPLE, lane))
                    if kind == STRATIFIED:
                        bits = stratified_bits(pixel_key, key, sample, dimension, np.uint32(option))
                    else:
                        bits = random_bits(key, sample)
                    put(lanes, at.DRAW + k, lane, real(bits >> np.uint32(shift)) * real(scale))
            if beyond:
                _random_beyond(lanes, k, columns, np.uint32(shift), real(scale), real)

    return draw


@inline
def _random_beyond(lanes, k, columns, shift, scale, real):
    for lane in range(np.uint64(LANES)):
        dimension = get_int(lanes, at.DIMENSION, lane) + k
        key = dimension_key(np.uint32(get_int(lanes, at.PIXEL_KEY, lane)), np.uint32(dimension))
        bits = random_bits(key, np.uint32(get_int(lanes, at.SAMPLE, lane)))
        if dimension >= columns:
            put(lanes, at.DRAW + k, lane, real(bits >> shift) * scale)


@cache
def stages(name: str, scrambled: bool, real: Any) -> tuple[Any, Any]:
    """(draws for the camera, draws for a vertex) of a built-in sampler."""
    kind = CODES[name]
    return compile_stage(_make(kind, scrambled, 2, real)), compile_stage(_make(kind, scrambled, DRAWS, real))


def _make_plugin(function: Any, draws: int, real: Any) -> Any:
    def draw(block, world):
        lanes = pointer(block, real)
        seed = np.uint32(count(world, SEED_KEY))
        for lane in range(np.uint64(LANES)):
            dimension = get_int(lanes, at.DIMENSION, lane)
            sample = get_int(lanes, at.SAMPLE, lane)
            pixel = get_int(lanes, at.PIXEL, lane)
            for k in range(draws):
                u = function(np.uint32(pixel), np.uint32(sample), np.uint32(dimension + k), seed)
                # draws become places in tables, so one that is not in [0, 1), NaN among them, must not get through
                u = u if u >= const(0.0, u) else const(0.0, u)
                put(lanes, at.DRAW + k, lane, real(min(u, const(1.0, u) - const(2.0**-24, u))))

    return draw


@cache
def plugin_stages(function: Any, real: Any) -> tuple[Any, Any]:
    """The same for a user's `@njit` function (pixel, sample, dimension, seed) -> float in [0, 1)."""
    return tuple(compile_stage(_make_plugin(function, n, real), on_disk=False) for n in (2, DRAWS))  # type: ignore[return-value]


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
    """The table (samples first .. last - 1, dimensions) that the stage of `sampler` reads; empty where it reads none."""
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
