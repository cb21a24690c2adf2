"""Vectors of eight numbers do to each what scalar code does, and reduce as NumPy does."""

import numba
import numpy as np
import pytest

from engines.kernels.compile import simd
from engines.kernels.compile.jit import OPTIONS
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.processor import has_feature
from engines.kernels.compile.simd import bits, convert, iota, lane, lesser, load8, lowest, packed, splat, store8, swapped
from engines.kernels.compile.values import select
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.shapes.triangle import triangle_distance
from engines.kernels.lane.vector import Vec3

RNG = np.random.default_rng(11)


@numba.njit(**OPTIONS)
def reduced(values, result):
    table, out = array_at(values.ctypes.data, np.int32), array_at(result.ctypes.data, np.int32)
    eight = load8(table, 0)
    store8(out, 0, packed(eight, eight > np.int32(3)))
    store8(out, 8, swapped(eight))
    store8(out, 16, select(eight > np.int32(3), eight, np.int32(-7)))
    out[24] = lowest(eight)
    out[25] = lane(eight, 5)
    return bits((eight > np.int32(3)) | (iota() == np.int32(0))), bits(iota() < np.int32(5))


def test_eight_integers_are_packed_reduced_and_selected():
    for _ in range(500):
        values, out = RNG.integers(-9, 20, 8).astype(np.int32), np.zeros(26, np.int32)
        some, first = reduced(values, out)
        large = values[values > 3].tolist()
        assert out[: len(large)].tolist() == large
        assert out[8:16].tolist() == np.roll(values, 4).tolist()
        assert out[16:24].tolist() == np.where(values > 3, values, -7).tolist()
        assert (out[24], out[25]) == (values.min(), values[5])
        assert (some, first) == (sum(1 << k for k in range(8) if values[k] > 3 or k == 0), 31)


@pytest.mark.parametrize("features", [{"avx2"}, {"avx2", "avx512vl"}, set()], ids=["table", "instruction", "any machine"])
def test_packed_numbers_are_the_same_by_every_way_to_pack_them(features, monkeypatch):
    if not features <= {name for name in ("avx2", "avx512vl") if has_feature(name)}:
        pytest.skip(f"no {sorted(features)[-1]}")
    monkeypatch.setattr(simd, "has_feature", features.__contains__)

    @numba.njit(**OPTIONS)
    def pack(values, result):
        eight = load8(array_at(values.ctypes.data, np.int32), 0)
        store8(array_at(result.ctypes.data, np.int32), 0, packed(eight, eight > np.int32(0)))

    for mask in range(256):
        values, out = np.array([k + 1 if mask >> k & 1 else -1 for k in range(8)], np.int32), np.zeros(8, np.int32)
        pack(values, out)
        assert out[: mask.bit_count()].tolist() == values[values > 0].tolist()


@numba.njit(**OPTIONS)
def distances(corners, result, least, real):
    table, out = array_at(corners.ctypes.data, real), array_at(result.ctypes.data, real)
    a, b, c = (
        Vec3(load8(table, 0), load8(table, 8), load8(table, 16)),
        Vec3(load8(table, 24), load8(table, 32), load8(table, 40)),
        Vec3(load8(table, 48), load8(table, 56), load8(table, 64)),
    )
    store8(out, 0, triangle_distance(a, b, c))
    store8(array_at(least.ctypes.data, real), 0, lesser(a.x, -b.x))
    for k in range(8):
        p, q, r = corners[0:3, k], corners[3:6, k], corners[6:9, k]
        out[8 + k] = triangle_distance(Vec3(p[0], p[1], p[2]), Vec3(q[0], q[1], q[2]), Vec3(r[0], r[1], r[2]))


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_triangle_of_eight_is_as_far_as_one_alone_bit_for_bit(real):
    hits = 0
    for _ in range(200):
        corners, out, least = RNG.normal(size=(9, 8)).astype(real), np.zeros((2, 8), real), np.zeros(8, real)
        distances(corners, out, least, real)
        assert np.array_equal(out[0], out[1])
        assert np.array_equal(least, np.minimum(corners[0], -corners[3]))
        hits += np.isfinite(out[0]).sum()
    assert hits > 100


@numba.njit(**OPTIONS)
def sphere_hits(spheres, result):
    table, out = array_at(spheres.ctypes.data, np.float64), array_at(result.ctypes.data, np.float32)
    o, d = Vec3(0.1, 0.2, -3.0), Vec3(0.0, 0.6, 0.8)
    t = sphere_distance(o, d, Vec3(load8(table, 0), load8(table, 8), load8(table, 16)), load8(table, 24))
    store8(out, 0, convert(t, np.float32))
    store8(out, 8, convert(splat(2.75), np.float32))
    for k in range(8):
        out[16 + k] = np.float32(sphere_distance(o, d, Vec3(spheres[0, k], spheres[1, k], spheres[2, k]), spheres[3, k]))


def test_a_sphere_of_eight_is_as_far_as_one_alone_bit_for_bit():
    for _ in range(50):
        spheres, out = RNG.normal(size=(4, 8)), np.zeros((3, 8), np.float32)
        spheres[3] = abs(spheres[3]) + 1
        sphere_hits(spheres, out)
        assert np.array_equal(out[0], out[2])
        assert (out[1] == 2.75).all()
