"""Textures that spot lights and projectors show: they are looked up where light samples leave through the frame of the light.
Scalar code: what is read differs from lane to lane."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.flatten.lights import PROJECTOR, SPOT
from engines.kernels.lane.vector import Vec3, dot, to_float64
from engines.kernels.layout import LANES, MISS
from engines.kernels.stages.textures import as_light, color_at


@cache
def make_light_samples(real: Any) -> Any:
    """The function (rays, scene) that multiplies the light samples of the batch by the textures of their lights. Outside of its
    frame, a light is black."""
    black = Vec3(real(0), real(0), real(0))

    @inline
    def light_samples(rays, scene):
        for lane in range(np.uint64(LANES)):
            kind = rays.light_kind[lane]
            if rays.alive[lane] and rays.hit.kind[lane] != MISS and kind in (SPOT, PROJECTOR):
                frame = scene.light_frames[rays.chosen_light[lane]]
                texture = np.int64(frame.texture)
                if texture >= 0:
                    wi = to_float64(rays.light_sample.wi[lane])  # -d of `LightFrameRow`: the signs of u and v cancel
                    depth = dot(wi, frame.axis)
                    u, v = 0.5 + dot(wi, frame.across) / depth, 0.5 + dot(wi, frame.down) / depth
                    shown = black
                    if depth < 0.0 and 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0:
                        shown = rays.light_sample.radiance[lane] * as_light(color_at(scene, texture, u, v), real)
                    rays.light_sample.radiance[lane] = shown

    return light_samples
