"""Random and quasi-random numbers: pure functions of (pixel, sample, dimension, seed), see docs/transport.md."""

from __future__ import annotations

import numpy as np

from engines.kernels.compile.jit import inline

GOLDEN = 0x9E3779B9


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
    order_key = mix(np.uint32(dimension_key(pixel_key, even) + np.uint32(np.uint32(sample >> bits) * np.uint32(GOLDEN))))
    one = np.uint32(1)
    cell = permute(np.uint32(sample & np.uint32(np.uint32(one << bits) - one)), bits, order_key)
    odd = np.uint32(dimension & one)
    cell = np.uint32((cell >> np.uint32(odd * m)) & np.uint32(np.uint32(one << m) - one))
    return np.uint32(np.uint32(cell << np.uint32(np.uint32(32) - m)) | (random_bits(key, sample) >> m))


# ---- one function a sampler: (pixel_key, key, sample, dimension, point, option) -> 32 bits ------------------------------


@inline
def random(pixel_key, key, sample, dimension, point, option):
    return random_bits(key, sample)


@inline
def stratified(pixel_key, key, sample, dimension, point, option):
    """`option`: the bits of a grid's side."""
    return stratified_bits(pixel_key, key, sample, dimension, np.uint32(option))


@inline
def unscrambled(pixel_key, key, sample, dimension, point, option):
    return point


@inline
def owen_scrambled(pixel_key, key, sample, dimension, point, option):
    return owen_scramble(point, key)


@inline
def rotated(pixel_key, key, sample, dimension, point, option):
    """Cranley and Patterson's rotation."""
    return np.uint32(point + key)
