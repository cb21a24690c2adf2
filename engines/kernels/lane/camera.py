"""Cameras: functions (row, across, up) -> (origin, direction), float64, of a `CameraRow` and of a place on the image, in half
widths to the right of the axis of view and in half heights above it. Directions are not normalised."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.vector import sin_cos_turn


@inline
def perspective(camera, across, up):
    return camera.eye, camera.forward + (camera.right * across + camera.up * up)


@inline
def thin_lens(camera, across, up, u0, u1):
    """The ray from a point of the aperture, of two numbers in [0, 1), through what the pinhole's ray meets in focus."""
    _, ahead = perspective(camera, across, up)
    sine, cosine = sin_cos_turn(u1)
    radius = math.sqrt(u0)
    aside = camera.lens_right * (radius * cosine) + camera.lens_up * (radius * sine)
    return camera.eye + aside, ahead * camera.focus_distance - aside


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
