"""The samplers against the specification written out once more, in plain Python integers, and against scipy."""

import numpy as np
import pytest
from scipy.stats import qmc

from engines.choices import SAMPLERS, resolve
from engines.numpy_reference.sampler import Sampler
from engines.sobol_numbers import DIRECTIONS

M = 2**32
G = 0x9E3779B9


def mix(x):
    x ^= x >> 16
    x = x * 0x7FEB352D % M
    x ^= x >> 15
    x = x * 0x846CA68B % M
    return x ^ x >> 16


def dim_key(pixel, d, seed):
    seed_key = mix((mix(seed % M) + seed // M) % M)
    return mix((mix((mix(pixel) + seed_key) % M) + d * G) % M)


def random(pixel, s, d, seed):
    return mix((dim_key(pixel, d, seed) + s * G) % M)


def reversed_bits(x):
    return int(f"{x:032b}"[::-1], 2)


def owen(x, k):
    y = reversed_bits(x)
    y ^= y * 0x3D20ADEA % M
    y = (y + k) % M
    y = y * (k >> 16 | 1) % M
    y ^= y * 0x05526C56 % M
    y ^= y * 0x53A22864 % M
    return reversed_bits(y)


def sobol(s, d):
    x = 0
    for k in range(32):
        x ^= int(DIRECTIONS[d, k]) if s >> k & 1 else 0
    return x


def halton(s, d):
    primes = [p for p in range(2, 132) if all(p % q for q in range(2, p))]
    base, digits = primes[d], []
    while s:
        digits.append(s % base)
        s //= base
    numerator = sum(digit * base ** (len(digits) - 1 - i) for i, digit in enumerate(digits))
    return int(numerator / base ** len(digits) * 2.0**32)


def permute(i, bits, k):
    w, h = 2**bits - 1, max(1, bits // 2)
    for salt, factor in ((k, 0x7FEB352D), (None, 0x846CA68B), (k >> 16, 0x9E3779B1)):
        i = (i + (k >> 8) if salt is None else i ^ salt) & w
        i = i * factor & w
        i ^= i >> h
    return i


def stratified(pixel, s, d, seed, strata):
    m = (strata.bit_length() - 1) // 2
    k = mix((dim_key(pixel, d - d % 2, seed) + s // strata * G) % M)
    c = permute(s % strata, 2 * m, k)
    cell = c // 2**m if d % 2 else c % 2**m
    return cell << (32 - m) | random(pixel, s, d, seed) >> m


SPECIFIED = {
    "random": random,
    "sobol": lambda p, s, d, seed: owen(sobol(s, d), dim_key(p, d, seed)) if d < 64 else random(p, s, d, seed),
    "sobol none": lambda p, s, d, seed: sobol(s, d) if d < 64 else random(p, s, d, seed),
    "halton": lambda p, s, d, seed: (halton(s, d) + dim_key(p, d, seed)) % M if d < 32 else random(p, s, d, seed),
    "halton none": lambda p, s, d, seed: halton(s, d) if d < 32 else random(p, s, d, seed),
    "stratified 4": lambda p, s, d, seed: stratified(p, s, d, seed, 4),
    "stratified 64": lambda p, s, d, seed: stratified(p, s, d, seed, 64),
    "stratified 4096": lambda p, s, d, seed: stratified(p, s, d, seed, 4096),
}


def sampler(text, seed=7):
    name, _, option = text.partition(" ")
    given = {"name": name}
    if option:
        given["strata" if name == "stratified" else "scramble"] = int(option) if option.isdigit() else option
    return Sampler(resolve("sampler", given, SAMPLERS), seed)


@pytest.mark.parametrize("text", SPECIFIED)
@pytest.mark.parametrize("seed", [0, 7, 2**64 - 1, 5 * 2**32 + 1])
def test_every_draw_is_the_one_that_the_specification_names(text, seed):
    pixels = np.array([0, 1, 77, 65_535, 2**32 - 1])
    for s in (0, 1, 2, 63, 64, 1000, 123_456, 2**31 + 5):
        for d in (0, 1, 2, 3, 31, 32, 63, 64, 65, 1000):
            drawn = sampler(text, seed).draw(pixels, s, d)
            assert [SPECIFIED[text](int(p), s, d, seed) * 2.0**-32 for p in pixels] == drawn.tolist()


def test_the_constant_sampler_draws_its_value():
    draws = Sampler(resolve("sampler", {"name": "constant", "value": 0.3}, SAMPLERS), 1).draw(np.arange(5), 9, 3)
    assert draws.tolist() == [0.3] * 5


def test_unscrambled_sobol_points_are_those_of_scipy():
    expected = qmc.Sobol(64, scramble=False, bits=32).random(256)  # in Gray-code order
    drawn = [[float(sampler("sobol none").draw(np.zeros(1), i ^ i >> 1, d)[0]) for d in range(64)] for i in range(256)]
    assert np.array_equal(drawn, expected)


def test_halton_starts_as_it_must():
    first = [[sampler("halton none").draw(np.zeros(1), s, d)[0] for d in (0, 1)] for s in range(5)]
    expected = [(0, 0), (1 / 2, 1 / 3), (1 / 4, 2 / 3), (3 / 4, 1 / 9), (1 / 8, 4 / 9)]
    assert np.allclose(first, expected, rtol=0, atol=2.0**-32)


@pytest.mark.parametrize("text", ["sobol", "sobol none"])
def test_sobol_puts_one_point_in_every_elementary_interval(text):
    m = 6
    for pixel in (0, 12, 345):
        x, y = (np.array([sampler(text).draw(np.array([pixel]), s, d)[0] for s in range(2**m)]) for d in (0, 1))
        for k in range(m + 1):
            cells = np.floor(x * 2**k) * 2 ** (m - k) + np.floor(y * 2 ** (m - k))
            assert len(np.unique(cells)) == 2**m


@pytest.mark.parametrize("strata", [4, 64, 1024])
def test_stratified_visits_every_cell_of_its_grid_once_a_tour(strata):
    side = int(strata**0.5)
    draw = sampler(f"stratified {strata}").draw
    for tour in (0, 3):
        x, y = (np.array([draw(np.array([5]), tour * strata + s, d)[0] for s in range(strata)]) for d in (4, 5))
        assert len(np.unique(np.floor(x * side) * side + np.floor(y * side))) == strata


@pytest.mark.parametrize("text", [*SPECIFIED])
def test_draws_lie_in_zero_to_one_and_average_one_half(text):
    """False alarm below 1e-6: five standard errors of 20,000 uniform draws of different pixels."""
    draws = sampler(text).draw(np.arange(20_000), 3, 70)
    assert draws.min() >= 0.0 and draws.max() < 1.0
    assert abs(draws.mean() - 0.5) < 5 * 12**-0.5 / 20_000**0.5


def test_a_sampler_plugin_may_give_bits_or_floats():
    class Plugin:
        name = "mine"

        def __init__(self, function):
            self.numpy = function

    for function, expected in (
        (lambda p, s, d, seed: (p + np.uint32(s)) << np.uint32(30), [0.25, 0.5]),
        (lambda p, s, d, seed: p * 0.125 + seed * 0.0625, [0.0625, 0.1875]),
    ):
        plugin = resolve("sampler", Plugin(function), SAMPLERS)
        assert Sampler(plugin, 1).draw(np.array([0, 1]), 1, 0).tolist() == expected
