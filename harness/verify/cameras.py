"""Cameras: which part of a scene a picture shows, to the pixel."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from engines.scene import Orthographic, Perspective
from harness.verify.case import Array, Measured, Section, measured
from harness.verify.stage import material, path_tracer, quad
from harness.verify.subject import Subject

SECTION = Section("cameras")
EYE, TARGET, UP = (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
DISTANCE = 3.0


def _seen(subject: Subject, camera: Perspective | Orthographic, half_width: float, half_height: float) -> Array:
    """Pixels that are not what they must be: a lamp fills the upper right quarter of the window but for two rows above and
    one column beside it; rays go through the middle of each pixel."""
    width, height = camera.resolution
    x = half_width * (2 * (np.arange(width) + 0.5) / width - 1)
    y = half_height * (1 - 2 * (np.arange(height) + 0.5) / height)
    right, top = half_width * (1 - 2 / width), half_height * (1 - 4 / height)  # one column, two rows are left free
    lamp = quad([(0.0, 0.0, 0.0), (right, 0.0, 0.0), (right, top, 0.0), (0.0, top, 0.0)], 0)
    image = subject.image([lamp], [material(emission=1)], [], camera, path_tracer(1), sampler="constant")
    lit = ((x > 0) & (x < right))[None, :] & ((y > 0) & (y < top))[:, None]
    return image != lit


@SECTION.case("cam", "A picture shows what its field of view, its sides and its axis say, upright.", "DESIGN 3")
def window(subject: Subject) -> Iterator[Measured]:
    for resolution in ((24, 16), (16, 24)):
        aspect = resolution[0] / resolution[1]
        for axis in ("x", "y"):
            for fov in (10.0, 60.0, 120.0):
                half = DISTANCE * math.tan(math.radians(fov) / 2)
                camera = Perspective(EYE, TARGET, UP, fov, axis, resolution)
                window = (half, half / aspect) if axis == "x" else (half * aspect, half)
                yield measured(_seen(subject, camera, *window), f"{fov:g} degrees along {axis}, {resolution[0]} wide")
        camera = Orthographic(EYE, TARGET, UP, 2.0, resolution)
        yield measured(_seen(subject, camera, aspect, 1.0), f"orthographic, {resolution[0]} wide")
