"""The material stage against docs/transport.md, one call on sixteen lanes: textures on a plane, of which (u, v) are metres, and
walks of nested wrappers.
"""

import ctypes

import numpy as np
import pytest

from engines.kernels.flatten import flatten
from engines.kernels.integrators.interface import Uses
from engines.kernels.layout import LANES, RayBatch
from engines.kernels.stages import material as stage_module
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    ImageTexture,
    Mask,
    Material,
    Mixture,
    NormalMap,
    Perspective,
    Plane,
    Scene,
    Sides,
)

CAMERA = Perspective((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 40.0, "y", (8, 8))
UPWARDS = Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), material=0)
TURNED = (0.5, -1.5, 0.25, 2.0, 0.75, -0.125)


class Lanes:
    """Sixteen hits, by the names of `RayBatch`: (numbers, lanes) float64, or int64 of whole numbers and flags."""

    def __init__(self):
        self.memory = np.zeros((RayBatch.size, LANES))
        self["alive"] = 1
        self["front"] = 1
        self["normal"] = self["geometric_normal"] = np.array([[0.0], [0.0], [1.0]])
        self["direction"] = np.array([[0.6], [0.0], [-0.8]])

    def _rows(self, name):
        field = RayBatch.fields[name]
        rows = self.memory[field.first : field.first + field.n]
        return rows.view(np.int64) if field.kind in ("integer", "flag") else rows

    def __getitem__(self, name):
        return self._rows(name)

    def __setitem__(self, name, values):
        self._rows(name)[:] = values


def shaded(bsdf, u=0.0, v=0.0, draw=0.5, **fields):
    """The lanes after the stage: each on the plane at (u, v), which has this BSDF."""
    scene = Scene("test", CAMERA, (Material("m", bsdf=bsdf),), (UPWARDS,), (), "")
    flat = flatten(scene, np.float64, np.float64)
    stage = stage_module.stage(flat.features, Uses(sample=True), np.float64)
    lanes = Lanes()
    lanes["shape"] = 2
    lanes["shape_parameters"][:6] = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]])
    lanes["point"] = np.stack(np.broadcast_arrays(u, v, np.zeros(LANES)))
    lanes["draw"][3] = draw
    for name, values in fields.items():
        lanes[name] = values
    ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(stage.address)(lanes.memory.ctypes.data, flat.address)
    return lanes


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


@pytest.mark.parametrize("channels", [1, 3])
def test_images_are_read_with_every_wrap_filter_and_transform(channels):
    rng = np.random.default_rng(5)
    pixels = rng.random((3, 4, channels), np.float32)
    u, v = rng.uniform(-3, 3, (2, LANES))
    for wrap in ("repeat", "mirror", "clamp"):
        for filter in ("bilinear", "nearest"):
            for to_uv in ((1.0, 0.0, 0.0, 0.0, 1.0, 0.0), TURNED):
                texture = ImageTexture(pixels, filter, wrap, to_uv)
                found = shaded(Mixture(kd=texture), u, v)["bsdf"][:3]
                assert np.allclose(found, texels_of(texture, u, v), rtol=0, atol=1e-12), (wrap, filter, to_uv)
