"""Cameras: functions (row, across, up) -> (origin, direction), float64, of a `CameraRow` and of a place on the image,
from -1 to 1 to the right and upwards. Directions are not normalised."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select


@inline
def perspective(camera, across, up):
    return camera.eye, camera.forward + (camera.right * across + camera.up * up)


@inline
def orthographic(camera, across, up):
    return camera.eye + (camera.right * across + camera.up * up), camera.forward


@inline
def perspective_arctan(camera, across, up):
    """`engines.scene.PerspectiveArctan`."""
    across, up = _arctan(across * camera.half_angle_x), _arctan(up * camera.half_angle_y)
    return camera.eye, camera.forward + (camera.right * across + camera.up * up)


@inline
def _arctan(x):
    """The polynomial of `PerspectiveArctan`."""
    size = abs(x)
    near = select(size > 1.0, 1.0 / size, size)
    value = near * (math.pi / 4 + (1.0 - near) * (0.2447 + 0.0663 * near))
    value = select(size > 1.0, math.pi / 2 - value, value)
    return select(x < 0.0, -value, value)
