"""The material stage against docs/transport.md, one call on sixteen lanes: textures on a plane, of which (u, v) are metres, and
walks of nested wrappers.
"""

import ctypes

import numpy as np
import pytest

from engines.kernels.flatten import flatten
from engines.kernels.flatten.palettes import BYTES, indexed
from engines.kernels.flatten.shapes import PLANE
from engines.kernels.layout import LANES, MISS, SURFACE, RayBatch, SceneTable
from engines.kernels.stages import material as stage_module
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Dielectric,
    ImageTexture,
    Mask,
    Material,
    Mesh,
    Mixture,
    NormalMap,
    Perspective,
    Plane,
    Scene,
    Sides,
    load_scene,
)

CAMERA = Perspective((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 40.0, "y", (8, 8))
UPWARDS = Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), material=0)
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
TURNED = (0.5, -1.5, 0.25, 2.0, 0.75, -0.125)


NAMES = {"front": "hit.front", "kind": "hit.kind", "normal": "hit.normal"}
NAMES |= {name: f"wrapped.{name}" for name in ("untilted_normal", "outer_normal")}
"""What fields are called in tests of several."""


class Lanes:
    """Sixteen hits, by the names of `RayBatch`: (numbers, lanes) float64, or int64 of whole numbers and flags."""

    def __init__(self):
        self.memory = np.zeros((RayBatch.size, LANES))
        self["alive"] = 1
        self["hit.front"] = 1
        self["hit.normal"] = self["hit.geometric_normal"] = np.array([[0.0], [0.0], [1.0]])
        self["direction"] = np.array([[0.6], [0.0], [-0.8]])

    def _rows(self, name):
        field = RayBatch.field(NAMES.get(name, name))
        rows = self.memory[field.first : field.first + field.n]
        return rows.view(np.int64) if field.kind in ("integer", "flag") else rows

    def __getitem__(self, name):
        return self._rows(name)

    def __setitem__(self, name, values):
        self._rows(name)[:] = values


def flattened(bsdf, *shapes):
    return flatten(Scene("test", CAMERA, (Material("m", bsdf=bsdf),), shapes, (), ""), np.float64, np.float64)


def run(flat, lanes):
    """The lanes after the stage."""
    stage = stage_module.stage(flat.features, np.float64)
    ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(stage.address)(lanes.memory.ctypes.data, flat.address)
    return lanes


def shaded(bsdf, u=0.0, v=0.0, **fields):
    """The lanes after the stage: each on the plane at (u, v), which has this BSDF."""
    lanes = Lanes()
    lanes["hit.shape"] = PLANE
    lanes["shape_parameters"][:6] = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]])
    lanes["hit.point"] = np.stack(np.broadcast_arrays(u, v, np.zeros(LANES)))
    for name, values in fields.items():
        lanes[name] = values
    return run(flattened(bsdf, UPWARDS), lanes)


def texels_of(texture, u, v):
    """(3, n) by transport.md, in NumPy."""
    m = texture.to_uv
    x, y = m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5]
    h, w, _ = texture.pixels.shape

    def index(i, n):
        if texture.wrap == "repeat":
            return i % n
        if texture.wrap == "clamp":
            return np.clip(i, 0, n - 1)
        return np.where(i % (2 * n) >= n, 2 * n - 1 - i % (2 * n), i % (2 * n))

    def texel(column, row):
        colors = texture.pixels[index(row, h), index(column, w)].astype(np.float64)
        return np.broadcast_to(colors, (*colors.shape[:-1], 3)).T

    if texture.filter == "nearest":
        return texel(np.floor(x * w).astype(int), np.floor(y * h).astype(int))
    x, y = x * w - 0.5, y * h - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - column, y - row
    above = texel(column, row) * (1 - fx) + texel(column + 1, row) * fx
    below = texel(column, row + 1) * (1 - fx) + texel(column + 1, row + 1) * fx
    return above * (1 - fy) + below * fy


LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


@pytest.mark.parametrize("channels", [1, 3])
def test_images_are_read_with_every_wrap_filter_and_transform(channels):
    rng = np.random.default_rng(5)
    pixels = rng.random((3, 4, channels), np.float32)
    u, v = rng.uniform(-3, 3, (2, LANES))
    for wrap in ("repeat", "mirror", "clamp"):
        for filter in ("bilinear", "nearest"):
            for to_uv in (IDENTITY, TURNED):
                texture = ImageTexture(pixels, filter, wrap, to_uv)
                found = shaded(Mixture(kd=texture), u, v)["bsdf"][:3]
                assert np.allclose(found, texels_of(texture, u, v), rtol=0, atol=1e-12), (wrap, filter, to_uv)


def test_what_is_not_finite_reads_the_first_texel():
    pixels = np.random.default_rng(6).random((3, 4, 3), np.float32)
    u = np.resize([np.inf, -np.inf, np.nan, 1e308], LANES)
    found = shaded(Mixture(kd=ImageTexture(pixels, to_uv=(1e10, 0.0, 0.0, 0.0, 1.0, 0.0))), u)["bsdf"][:3]
    assert np.array_equal(found, np.broadcast_to(pixels[0, 0][:, None], (3, LANES)))


def test_checkerboards_have_two_colours_as_numbers_two_luminances_and_values_keep_their_limits():
    rng = np.random.default_rng(7)
    u, v = rng.uniform(-3, 3, (2, LANES))
    board = Checkerboard((0.1, 0.7, 1.5), (0.9, -0.2, 0.3), TURNED)
    m = np.reshape(TURNED, (2, 3))
    x, y = m[:, :2] @ [u, v] + m[:, 2:]
    colors = np.where((x % 1 > 0.5) == (y % 1 > 0.5), *(np.array(c)[:, None] for c in (board.a, board.b)))
    found = shaded(Conductor((1.0,) * 3, (1.0,) * 3, (board, 0.25), reflectance=board), u, v)["bsdf"]
    assert np.array_equal(found[6:9], np.clip(colors, 0, 1))
    assert np.allclose(found[9], LUMINANCE @ colors, rtol=1e-15)
    assert (found[10] == 0.25).all()


GREYS = [Mixture(kd=(k / 8, k / 8, k / 8)) for k in range(8)]


def nested():
    """All wrappers that choose, several deep, with leaves that their kd tells apart; a leaf stands in two places."""
    inner = Blend(0.375, Mask(0.75, GREYS[1]), Sides(GREYS[2], None))
    return Mask(0.8, Blend(0.25, Sides(inner, Blend(0.5, GREYS[4], inner)), Mask(0.5, GREYS[5])))


def walked(bsdf, u, front):
    """(leaf, u, passing, opacity) by transport.md."""
    passing, opacity = False, 1.0
    while not isinstance(bsdf, Mixture):
        if isinstance(bsdf, Sides):
            bsdf = (bsdf.front if front else bsdf.back) or Mixture()
        elif isinstance(bsdf, Mask):
            o = bsdf.opacity
            opacity *= o
            if not passing:
                passing = u >= o
                u = (u - o) / (1 - o) if passing else u / o
            bsdf = bsdf.of
        else:
            w = bsdf.weight
            bsdf, u = (bsdf.b, u / w) if u < w else (bsdf.a, (u - w) / (1 - w))
    return bsdf, u, passing, opacity


def test_nested_wrappers_lead_to_one_leaf_with_what_is_left_of_the_draw():
    rng = np.random.default_rng(8)
    seen = set()
    for _ in range(20):
        u, front = rng.random(LANES), rng.integers(0, 2, LANES)
        draws = np.zeros((7, LANES))
        draws[3] = u
        lanes = shaded(nested(), draw=draws, front=front)
        expected = [walked(nested(), *pair) for pair in zip(u, front, strict=True)]
        assert np.array_equal(lanes["bsdf"][0], [leaf.kd[0] for leaf, *_ in expected])
        assert np.allclose(lanes["draw"][3], [rest for _, rest, *_ in expected], rtol=1e-12)
        assert np.array_equal(lanes["wrapped.passing"][0] != 0, [passing for *_, passing, _ in expected])
        assert np.allclose(lanes["wrapped.opacity"][0], [opacity for *_, opacity in expected], rtol=1e-15)
        seen |= {leaf.kd[0] for leaf, *_ in expected}
    assert seen == {0.0, 1 / 8, 2 / 8, 4 / 8, 5 / 8}


def test_lanes_without_a_hit_or_a_program_keep_what_they_have():
    bsdf = Blend(0.5, GREYS[3], Mask(0.25, GREYS[3]))
    lanes = shaded(bsdf, alive=[k % 2 for k in range(LANES)], kind=[(SURFACE, MISS)[k // 2 % 2] for k in range(LANES)])
    works = np.array([k % 2 == 1 and k // 2 % 2 == 0 for k in range(LANES)])
    assert np.array_equal(lanes["bsdf"][0] > 0, works)
    assert (lanes["wrapped.opacity"][0][~works] == 1).all()


def unit(x):
    return x / np.linalg.norm(x, axis=0)


def test_bump_maps_tilt_the_normal_by_the_slope_of_their_height():
    height = ImageTexture(np.random.default_rng(9).random((5, 6, 3), np.float32), to_uv=TURNED)
    u, v = np.random.default_rng(10).uniform(-2, 2, (2, LANES))
    lanes, d = shaded(Bump(height, 0.01, GREYS[2]), u, v), 1e-7

    def slope(du, dv):
        above, below = texels_of(height, u + du, v + dv), texels_of(height, u - du, v - dv)
        return 0.01 * LUMINANCE @ (above - below) / (2 * d)

    expected = unit(np.stack([-slope(d, 0), -slope(0, d), np.ones(LANES)]))
    assert np.allclose(lanes["hit.normal"], expected, atol=1e-6)
    assert np.ptp(lanes["hit.normal"][0]) > 0.01
    assert np.array_equal(lanes["wrapped.outer_normal"], lanes["wrapped.untilted_normal"])
    assert np.array_equal(lanes["wrapped.outer_normal"], np.tile([[0.0], [0.0], [1.0]], LANES))


def test_normal_maps_tilt_in_the_frame_of_the_surface_and_no_tilt_hides_the_surface_from_the_viewer():
    colors = np.random.default_rng(11).random((4, 4, 3), np.float32)
    inner, outer = ImageTexture(colors, "nearest"), Checkerboard((0.5, 0.6, 0.9), (0.4, 0.5, 0.8))
    u, v = np.random.default_rng(12).uniform(-2, 2, (2, LANES))
    once = shaded(NormalMap(inner, GREYS[2]), u, v)
    raw, n, wo = unit(2 * texels_of(inner, u, v) - 1), np.array([[0.0], [0.0], [1.0]]), np.array([-0.6, 0.0, 0.8])
    hidden = wo @ raw <= 0
    expected = np.where(hidden, raw * [[-1], [-1], [1]], raw)  # reflected at n
    black = hidden & (wo @ expected <= 0)
    expected = np.where(black, n, expected)
    assert hidden.any() and not hidden.all() and black.any()
    assert np.allclose(once["normal"], expected, atol=1e-12)
    assert np.array_equal(once["untilted_normal"], np.where(black, 0.0, n))
    twice, alone = shaded(NormalMap(outer, NormalMap(inner, GREYS[2])), u, v), shaded(NormalMap(outer, GREYS[2]), u, v)
    assert np.array_equal(twice["outer_normal"], np.tile(n, LANES))
    lit = twice["untilted_normal"].any(axis=0)
    assert lit.any() and np.array_equal(twice["untilted_normal"][:, lit], alone["normal"][:, lit])


@pytest.mark.parametrize("leaf", [GREYS[2], Dielectric(1.5, (0.3, 0.3))], ids=["opaque", "glass"])
def test_tilts_met_from_behind_turn_the_front_of_what_transmits_as_in_the_engine_numpy(leaf):
    rng = np.random.default_rng(14)
    u, v = rng.uniform(-2, 2, (2, LANES))
    n, wo = np.tile([[0.0], [0.0], [1.0]], LANES), np.tile([[-0.6], [0.0], [0.8]], LANES)
    front, none = np.arange(LANES) % 2 == 0, np.zeros(LANES, np.int64)
    height, texels = ImageTexture(rng.random((5, 6, 1), np.float32)), ImageTexture(rng.random((4, 4, 3), np.float32))
    for wrapper in (Bump(height, 0.05, leaf), NormalMap(texels, leaf)):
        lanes = shaded(wrapper, u, v, front=front)
        du, dv = np.tile([[1.0], [0.0], [0.0]], LANES), np.tile([[0.0], [1.0], [0.0]], LANES)
        at = SurfaceInteraction(0 * n, wo, n, n, du, front, none, none, np.zeros(LANES), np.stack([u, v]), dv)
        found, _ = Materials([Material("m", bsdf=wrapper)]).walk(at, np.full(LANES, 0.5))
        assert np.allclose(lanes["hit.normal"], found.normal, atol=1e-12)
        assert np.allclose(lanes["wrapped.untilted_normal"], found.wrapped.innermost, atol=1e-12)


def test_meshes_have_the_coordinates_of_their_vertices_and_brush_strokes_follow_them():
    rng = np.random.default_rng(13)
    corners, uvs = rng.random((3, 3)), np.array([[0.1, 0.9], [1.3, 0.2], [0.4, -0.7]])
    faces, used = np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)
    plain = Mesh(corners + 5, faces, used)
    mapped = Mesh(corners, faces, used, uvs=uvs)
    image = ImageTexture(rng.random((4, 4, 3), np.float32))
    lanes, (b1, b2) = Lanes(), rng.random((2, LANES)) / 2
    lanes["primitive"] = second = np.arange(LANES) % 2
    lanes["hit.u"], lanes["hit.v"] = b1, b2
    for k in range(3):
        lanes[f"face.vertex{k}"] = np.where(second, corners[k][:, None], corners[k][:, None] + 5)
    flat = flattened(Conductor((1.0,) * 3, (1.0,) * 3, (0.5, 0.25), reflectance=image), plain, mapped)
    run(flat, lanes)
    u, v = np.where(second, uvs.T @ [1 - b1 - b2, b1, b2], [b1, b2])
    assert np.allclose(lanes["bsdf"][6:9], texels_of(image, u, v), atol=1e-12)
    edges = corners[1:] - corners[0]
    dp_du = np.linalg.solve(uvs[1:] - uvs[0], edges)[0]  # rows: the edges are linear in (u, v)
    assert np.allclose(lanes["hit.tangent"], np.where(second, dp_du[:, None], edges[0][:, None]), atol=1e-12)


def test_scenes_without_wrappers_and_textures_have_no_material_stage_and_no_memory_for_it():
    scene = load_scene("metals")
    flat = flatten(scene, np.float32, np.float32)
    assert not flat.features.programs
    assert flat.table[SceneTable.programs.first] == flat.table[SceneTable.textures.first] == 0


def test_images_are_read_where_the_scene_holds_them_and_counted_once():
    pixels = np.random.default_rng(1).random((64, 64, 3), np.float32)
    once = flattened(Mixture(kd=ImageTexture(pixels)), UPWARDS)
    both = Blend(ImageTexture(pixels), Mixture(kd=ImageTexture(pixels, "nearest")), Mixture(ks=ImageTexture(pixels)))
    twice = flattened(both, UPWARDS)
    assert set(twice.arrays[SceneTable.texels]) == {pixels.ctypes.data}
    assert pixels.nbytes < once.bytes <= twice.bytes < pixels.nbytes + 4096


def test_an_image_of_256_different_numbers_takes_a_byte_each_and_gives_the_same_bits_as_one_of_more():
    rng = np.random.default_rng(2)
    numbers = np.append(rng.random(255, np.float32), np.float32(np.nan))
    image = numbers[rng.integers(0, 256, (32, 32, 3))]
    small = indexed(image)
    assert small is not None and small.nbytes == BYTES + image.size
    assert np.array_equal(small[:BYTES].view(np.float32)[small[BYTES:]], image.reshape(-1), equal_nan=True)
    image, more = np.nan_to_num(image), np.nan_to_num(image)
    more[16:] = rng.random((16, 32, 3), np.float32)  # below what the lanes read
    assert indexed(more) is None
    u, v = rng.random(LANES), rng.uniform(0.05, 0.4, LANES)
    few, many = (shaded(Mixture(kd=ImageTexture(pixels)), u, v)["bsdf"] for pixels in (image, more))
    assert np.array_equal(few, many) and np.ptp(few[:3]) > 0.1
