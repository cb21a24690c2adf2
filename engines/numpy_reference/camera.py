"""Rays of a camera: from places on the image to origins and unit directions.

A camera plugin carries a function `numpy(px, py, width, height, options)` that takes (n,) places in pixels, y downwards
from the top left corner, and returns origins and directions, (n, 3) each.
"""

from __future__ import annotations

import math

import numpy as np

from engines.numpy_reference.vectors import Array, cross, dot, unit
from engines.scene import Camera, CustomCamera, Orthographic, Perspective, PerspectiveArctan, ThinLens

Opening = Perspective | ThinLens | PerspectiveArctan | Orthographic


def camera_rays(
    camera: Camera, px: Array, py: Array, width: int, height: int, lens: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """Origins and unit directions, (3, n) each, through the places (px, py) in pixels, as if nothing were clipped.

    `lens`: two draws (n,) each, by which rays of a `ThinLens` choose their places on the aperture; None: its middle.
    """
    if isinstance(camera, CustomCamera):
        origins, directions = camera.plugin.numpy(px, py, width, height, camera.options)
        return np.array(origins, np.float64).T.copy(), unit(np.array(directions, np.float64).T)
    eye = np.array(camera.eye)[:, None]
    forward, right, up = _axes(camera)
    half_width, half_height = _half_extents(camera, width / height)
    x, y = px / width, py / height
    if not isinstance(camera, PerspectiveArctan):
        x, y = x - camera.principal_point[0], y - camera.principal_point[1]
        right = -right if camera.mirror else right
    across, upwards = (2.0 * x - 1.0) * half_width, (1.0 - 2.0 * y) * half_height
    if isinstance(camera, PerspectiveArctan):
        across, upwards = _arctan(across), _arctan(upwards)
    sideways = across * right + upwards * up
    if isinstance(camera, Orthographic):
        return eye + sideways, np.repeat(forward, px.size, axis=1)
    direction = unit(forward + sideways)
    if not isinstance(camera, ThinLens) or lens is None:
        return np.repeat(eye, px.size, axis=1), direction
    radius, phi = camera.aperture_radius * np.sqrt(lens[0]), 2.0 * np.pi * lens[1]
    origin = eye + radius * np.cos(phi) * right + radius * np.sin(phi) * up
    return origin, unit(eye + camera.focus_distance / dot(direction, forward) * direction - origin)


def clipped(camera: Camera, origin: Array, direction: Array) -> tuple[Array, Array] | None:
    """Where rays (3, n) of a camera start, (3, n), and the distance at which they end, (n,); None for one that does not
    clip."""
    if isinstance(camera, CustomCamera | PerspectiveArctan) or camera.clip == (0.0, math.inf):
        return None
    near, far = camera.clip
    slope = dot(direction, _axes(camera)[0])
    return origin + near / slope * direction, (far - near) / slope


def _axes(camera: Opening) -> tuple[Array, Array, Array]:
    """Unit vectors forward, right and up, (3, 1) each."""
    eye, target, up = (np.array(triple)[:, None] for triple in (camera.eye, camera.target, camera.up))
    forward = unit(target - eye)
    right = unit(cross(forward, up))
    return forward, right, cross(right, forward)


def _half_extents(camera: Opening, aspect: float) -> tuple[float, float]:
    """Half the width and height of the window: in metres, at distance 1 for a pinhole, in radians for an arctan map."""
    if isinstance(camera, Orthographic):
        across, high = camera.window(aspect)
        return across / 2.0, high / 2.0
    half = float(np.radians(camera.fov) / 2.0)
    if not isinstance(camera, PerspectiveArctan):
        half = float(np.tan(half))
    return (half, half / aspect) if camera.fov_axis == "x" else (aspect * half, half)


def _arctan(angle: Array) -> Array:
    """The polynomial of `PerspectiveArctan`, odd in `angle`."""
    size = np.abs(angle)
    near = np.where(size > 1.0, 1.0 / np.maximum(size, 1.0), size)
    slope = near * np.pi / 4.0 - near * (near - 1.0) * (0.2447 + 0.0663 * near)
    return np.sign(angle) * np.where(size > 1.0, np.pi / 2.0 - slope, slope)
