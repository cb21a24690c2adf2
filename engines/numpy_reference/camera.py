"""Rays of a camera: from places on the image to origins and unit directions.

A camera plugin carries a function `numpy(px, py, width, height, options)` that takes (n,) places in pixels, y downwards
from the top left corner, and returns origins and directions, (n, 3) each.
"""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array, cross, unit
from engines.scene import Camera, CustomCamera, Orthographic, Perspective, PerspectiveArctan

Opening = Perspective | PerspectiveArctan | Orthographic


def camera_rays(camera: Camera, px: Array, py: Array, width: int, height: int) -> tuple[Array, Array]:
    """Origins and unit directions, (3, n) each, through the places (px, py) in pixels."""
    if isinstance(camera, CustomCamera):
        origins, directions = camera.plugin.numpy(px, py, width, height, camera.options)
        return np.array(origins, np.float64).T.copy(), unit(np.array(directions, np.float64).T)
    eye = np.array(camera.eye)[:, None]
    forward, right, up = _axes(camera)
    half_width, half_height = _half_extents(camera, width / height)
    across, upwards = (2.0 * px / width - 1.0) * half_width, (1.0 - 2.0 * py / height) * half_height
    if isinstance(camera, PerspectiveArctan):
        across, upwards = _arctan(across), _arctan(upwards)
    sideways = across * right + upwards * up
    if isinstance(camera, Orthographic):
        return eye + sideways, np.repeat(forward, px.size, axis=1)
    return np.repeat(eye, px.size, axis=1), unit(forward + sideways)


def _axes(camera: Opening) -> tuple[Array, Array, Array]:
    """Unit vectors forward, right and up, (3, 1) each."""
    eye, target, up = (np.array(triple)[:, None] for triple in (camera.eye, camera.target, camera.up))
    forward = unit(target - eye)
    right = unit(cross(forward, up))
    return forward, right, cross(right, forward)


def _half_extents(camera: Opening, aspect: float) -> tuple[float, float]:
    """Half the width and height of the window: in metres, at distance 1 for a pinhole, in radians for an arctan map."""
    if isinstance(camera, Orthographic):
        return aspect * camera.height / 2.0, camera.height / 2.0
    half = float(np.radians(camera.fov) / 2.0)
    if isinstance(camera, Perspective):
        half = float(np.tan(half))
    return (half, half / aspect) if camera.fov_axis == "x" else (aspect * half, half)


def _arctan(angle: Array) -> Array:
    """The polynomial of `PerspectiveArctan`, odd in `angle`."""
    size = np.abs(angle)
    near = np.where(size > 1.0, 1.0 / np.maximum(size, 1.0), size)
    slope = near * np.pi / 4.0 - near * (near - 1.0) * (0.2447 + 0.0663 * near)
    return np.sign(angle) * np.where(size > 1.0, np.pi / 2.0 - slope, slope)
