"""The five samplers: pure functions of (pixel, sample, dimension, seed), as docs/transport.md defines them.

Integers are 32-bit unsigned with wrap-around, one for each pixel of an array. A sampler plugin is an object with a
`name` and a function `numpy(pixel, sample, dimension, seed)` that takes an (n,) uint32 array and three integers and
returns (n,) uint32 bits, or floats in [0, 1).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.numpy_reference.vectors import Array
from engines.sobol_numbers import DIRECTIONS

Bits = NDArray[np.uint32]
Draw = Callable[[Bits, int, int], NDArray]

GOLDEN = 0x9E3779B9
PRIMES = (
    2,
    3,
    5,
    7,
    11,
    13,
    17,
    19,
    23,
    29,
    31,
    37,
    41,
    43,
    47,
    53,
    59,
    61,
    67,
    71,
    73,
    79,
    83,
    89,
    97,
    101,
    103,
    107,
    109,
    113,
    127,
    131,
)


class Sampler:
    """Draws numbers in [0, 1) for the chosen sampler and seed."""

    def __init__(self, choice: Choice, seed: int) -> None:
        self._draw = _plugin(choice, seed) if choice.plugin is not None else _BUILT_IN[choice.name](choice, Keys(seed))

    def draw(self, pixels: NDArray[np.integer], sample: int, dimension: int) -> Array:
        """(n,) float64 in [0, 1): one draw for each pixel index y * width + x."""
        drawn = self._draw(np.asarray(pixels).astype(np.uint32), sample, dimension)
        return drawn * 2.0**-32 if drawn.dtype == np.uint32 else np.asarray(drawn, np.float64)


def mix(x: Bits) -> Bits:
    """A bijection of 32-bit integers without visible pattern (Wellons, lowbias32)."""
    x = x ^ (x >> 16)
    x = x * 0x7FEB352D
    x = x ^ (x >> 15)
    x = x * 0x846CA68B
    return x ^ (x >> 16)


class Keys:
    """The hash of (seed, pixel, dimension) that random numbers and scrambles start from."""

    def __init__(self, seed: int) -> None:
        low, high = np.array([seed % 2**32], np.uint32), np.array([seed >> 32], np.uint32)
        self._seed_key = mix(mix(low) + high)

    def dimension(self, pixels: Bits, dimension: int) -> Bits:
        """dim_key: (n,), different for each dimension of each pixel."""
        pixel_key = mix(mix(pixels) + self._seed_key)
        return mix(pixel_key + dimension * GOLDEN % 2**32)

    def random(self, pixels: Bits, sample: int, dimension: int) -> Bits:
        """(n,) independent random bits."""
        return mix(self.dimension(pixels, dimension) + sample * GOLDEN % 2**32)


def sobol_point(sample: int, dimension: int) -> int:
    """The 32 bits of Sobol point number `sample` in plain binary order; `dimension` below 64."""
    bits = [k for k in range(32) if sample >> k & 1]
    return int(np.bitwise_xor.reduce(DIRECTIONS[dimension, bits]))


def owen(x: int, key: Bits) -> Bits:
    """Nested uniform scrambling of 32 bits by a hash (Laine and Karras 2011, with Vegdahl's constants)."""
    y = reverse_bits(np.full_like(key, x))
    y = y ^ (y * 0x3D20ADEA)
    y = y + key
    y = y * ((key >> 16) | 1)
    y = y ^ (y * 0x05526C56)
    y = y ^ (y * 0x53A22864)
    return reverse_bits(y)


def reverse_bits(x: Bits) -> Bits:
    """Bit 0 becomes bit 31, and so on."""
    for shift, low in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        x = ((x >> shift) & low) | ((x & low) << shift)
    return (x >> 16) | (x << 16)


def halton_point(sample: int, dimension: int) -> int:
    """floor(2^32 phi_b(sample)), where phi mirrors the digits in the base, the `dimension`-th prime, at the point."""
    base = PRIMES[dimension]
    mirrored, scale = 0, 1
    while sample:
        sample, digit = divmod(sample, base)
        mirrored, scale = mirrored * base + digit, scale * base
    return int(2.0**32 * (mirrored / scale))


def permute(index: int, bits: int, key: Bits) -> Bits:
    """(n,) where the key's permutation of 0 .. 2^bits - 1 sends `index`."""
    low, half = 2**bits - 1, max(1, bits // 2)
    i = (index ^ key) & low
    i = (i * 0x7FEB352D) & low
    i = i ^ (i >> half)
    i = (i + (key >> 8)) & low
    i = (i * 0x846CA68B) & low
    i = i ^ (i >> half)
    i = (i ^ (key >> 16)) & low
    i = (i * 0x9E3779B1) & low
    return i ^ (i >> half)


def _random(choice: Choice, keys: Keys) -> Draw:
    return keys.random


def _constant(choice: Choice, keys: Keys) -> Draw:
    return lambda pixels, sample, dimension: np.full(pixels.shape, float(choice.options["value"]))


def _sobol(choice: Choice, keys: Keys) -> Draw:
    def draw(pixels: Bits, sample: int, dimension: int) -> Bits:
        if dimension >= len(DIRECTIONS):
            return keys.random(pixels, sample, dimension)
        x = sobol_point(sample, dimension)
        scrambled = choice.options["scramble"] == "owen"
        return owen(x, keys.dimension(pixels, dimension)) if scrambled else np.full_like(pixels, x)

    return draw


def _halton(choice: Choice, keys: Keys) -> Draw:
    def draw(pixels: Bits, sample: int, dimension: int) -> Bits:
        if dimension >= len(PRIMES):
            return keys.random(pixels, sample, dimension)
        x = np.full_like(pixels, halton_point(sample, dimension))
        return x + keys.dimension(pixels, dimension) if choice.options["scramble"] == "rotation" else x

    return draw


def _stratified(choice: Choice, keys: Keys) -> Draw:
    strata = choice.options["strata"]
    m = (strata.bit_length() - 1) // 2

    def draw(pixels: Bits, sample: int, dimension: int) -> Bits:
        """Each pair of dimensions visits the cells of a 2^m x 2^m grid in an order of its own, jittered inside."""
        tour, step = divmod(sample, strata)
        key = mix(keys.dimension(pixels, dimension - dimension % 2) + tour * GOLDEN % 2**32)
        place = permute(step, 2 * m, key)
        cell = place >> m if dimension % 2 else place & (2**m - 1)
        return (cell << (32 - m)) | (keys.random(pixels, sample, dimension) >> m)

    return draw


def _plugin(choice: Choice, seed: int) -> Draw:
    more = (choice.options,) if choice.options else ()
    return lambda pixels, sample, dimension: np.asarray(choice.plugin.numpy(pixels, sample, dimension, seed, *more))


_BUILT_IN: dict[str, Callable[[Choice, Keys], Draw]] = {
    "constant": _constant,
    "stratified": _stratified,
    "halton": _halton,
    "random": _random,
    "sobol": _sobol,
}
