"""The scene in raybench's terms: metres, y up, radiance; what any engine can render.

A hundred of the original's units are a metre. Its balls add a whole mirror to a diffuse colour, which no surface can do. A
faint colour under a strong sun comes near it: kd = colour / 64 under an irradiance of 64 pi, so that the sun's share is the
original's, and ks = 63/64. The probe becomes a sky that is the same in front and behind. Cameras agree where images are square.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.dahlquist.animation import COLOURS, FOCAL, RADII, Reals
from engines.dahlquist.pictures import Picture

UNITS_A_METRE = 100.0
FAINTNESS = 64
NAMES = ("red", "green", "blue", "yellow", "purple")
SUN = (-10.0, -5.0, -10.0)
"""Direction of travel of the sun's light. The sun stands behind the viewer, to the right and above."""


def to_world(points: Any) -> NDArray[np.float64]:
    """(..., 3) depth, right, down as x right, y up, z towards the viewer; in metres."""
    depth, right, down = np.moveaxis(np.asarray(points, np.float64), -1, 0) / UNITS_A_METRE
    return np.stack([right, -down, -depth], axis=-1)


def from_world(points: Any) -> Reals:
    """The inverse of `to_world`."""
    x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0) * UNITS_A_METRE
    return np.stack([-z, x, -y], axis=-1).astype(np.float32)


def scene(centres: Reals, sky: str, size: int = 640) -> dict[str, Any]:
    """The mapping of a scene file, with balls at `centres` (5, 3) and the image file `sky`."""
    balls = zip(NAMES, to_world(centres), RADII / UNITS_A_METRE, COLOURS / 255.0 / FAINTNESS, strict=True)
    shapes, materials = [], {}
    for name, center, radius, kd in balls:
        materials[name] = {"kd": kd.tolist(), "ks": 1 - 1 / FAINTNESS}
        shapes.append({"sphere": {"center": center.tolist(), "radius": float(radius)}, "material": name})
    camera = {
        "type": "perspective",
        "eye": [0, 0, 0],
        "target": [0, 0, -1],
        "up": [0, 1, 0],
        "fov": field_of_view(),
        "fov_axis": "x",
        "resolution": [size, size],
    }
    sun = {"directional": {"direction": list(SUN), "irradiance": math.pi * FAINTNESS}}
    return {
        "raybench_scene": 1,
        "name": "Dahlquist's five balls",
        "camera": camera,
        "materials": materials,
        "shapes": shapes,
        "lights": [sun, {"environment": {"image": sky}}],
    }


def field_of_view() -> float:
    """Degrees that the width of an image spans."""
    return math.degrees(2 * math.atan(0.5 / float(FOCAL)))


def sky(probe: Picture, height: int = 128) -> NDArray[np.float64]:
    """(height, 2 height, 3) radiance of the probe by latitude and longitude, as environments want it."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    right, down = np.sin(2 * np.pi * u) * np.sin(np.pi * v), -np.cos(np.pi * v)
    rows, columns = probe.shape[0] * (down / 4 + 0.5), probe.shape[1] * (right / 4 + 0.5)
    return probe[rows.astype(int), columns.astype(int)] / 255.0
