"""Cameras: which part of a scene the image shows, to the pixel."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from engines.scene import Orthographic, Perspective
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.scenes import material, path_tracer, quad
from harness.verify.subject import Subject

SECTION = Section("cameras")
EYE, TARGET, UP = (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
DISTANCE = 3.0


def _seen(subject: Subject, camera: Perspective | Orthographic, half_width: float, half_height: float) -> Array:
    """(height, width) bool: wrong pixels. A light fills the upper right quarter of the image except two rows and one column.

    Rays go through the centres of pixels.
    """
    width, height = camera.resolution
    x = half_width * (2 * (np.arange(width) + 0.5) / width - 1)
    y = half_height * (1 - 2 * (np.arange(height) + 0.5) / height)
    right, top = half_width * (1 - 2 / width), half_height * (1 - 4 / height)  # one column, two rows are left free
    emitter = quad([(0.0, 0.0, 0.0), (right, 0.0, 0.0), (right, top, 0.0), (0.0, top, 0.0)], 0)
    image = subject.image([emitter], [material(emission=1)], [], camera, path_tracer(1), sampler="constant")
    lit = ((x > 0) & (x < right))[None, :] & ((y > 0) & (y < top))[:, None]
    return image != lit


@SECTION.case("cam", "The image shows what field of view, aspect and axis select, upright.", "engines.interface")
def window(subject: Subject) -> Iterator[Measurement]:
    for resolution in ((24, 16), (16, 24)):
        aspect = resolution[0] / resolution[1]
        for axis in ("x", "y"):
            for fov in (10.0, 60.0, 120.0):
                half = DISTANCE * math.tan(math.radians(fov) / 2)
                camera = Perspective(EYE, TARGET, UP, fov, axis, resolution)
                window = (half, half / aspect) if axis == "x" else (half * aspect, half)
                yield measurement(_seen(subject, camera, *window), f"{fov:g} degrees along {axis}, {resolution[0]} wide")
        camera = Orthographic(EYE, TARGET, UP, 2.0, resolution)
        yield measurement(_seen(subject, camera, aspect, 1.0), f"orthographic, {resolution[0]} wide")
