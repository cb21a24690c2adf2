"""Projection between pixels and space: the ray through a position in the image, and the position of a point.

Positions x and y are real numbers in pixels from the top left corner; the centre of the first pixel is at one half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.errors import Unsupported
from engines.scene import Camera, CustomCamera, Orthographic, Perspective, PerspectiveArctan, ThinLens

Vector = NDArray[np.float64]


def unit(vector: Vector) -> Vector:
    return vector / np.linalg.norm(vector)


def arctan_slope(angle: float) -> float:
    """A(angle) of `PerspectiveArctan`, odd."""
    size = abs(angle)
    near = 1.0 / size if size > 1.0 else size
    slope = near * (math.pi / 4 + (1.0 - near) * (0.2447 + 0.0663 * near))
    return math.copysign(math.pi / 2 - slope if size > 1.0 else slope, angle)


@dataclass(frozen=True)
class Projection:
    """A camera with an image size; a thin lens is taken for its pinhole. Raises `Unsupported` for a camera plugin, whose
    projection is unknown."""

    camera: Camera
    width: int
    height: int

    def __post_init__(self) -> None:
        if isinstance(self.camera, CustomCamera):
            raise Unsupported("the scene's camera is a plugin: neither camera nor objects can be moved")

    @property
    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """Unit vectors forward, right and up in the image."""
        assert not isinstance(self.camera, CustomCamera)
        eye, target, up = (np.array(triple) for triple in (self.camera.eye, self.camera.target, self.camera.up))
        forward = unit(target - eye)
        right = unit(np.cross(forward, up))
        mirror = not isinstance(self.camera, PerspectiveArctan) and self.camera.mirror
        return forward, -right if mirror else right, np.cross(right, forward)

    @property
    def _middle(self) -> tuple[float, float]:
        """Position of the axis of view, in pixels."""
        assert not isinstance(self.camera, CustomCamera)
        x, y = (0.0, 0.0) if isinstance(self.camera, PerspectiveArctan) else self.camera.principal_point
        return (0.5 + x) * self.width, (0.5 + y) * self.height

    @property
    def _half(self) -> tuple[float, float]:
        """Half the width and height of the window: in metres (orthographic), as slopes, or in radians (arctan)."""
        aspect = self.width / self.height
        if isinstance(self.camera, Orthographic):
            across, high = self.camera.window(aspect)
            return across / 2, high / 2
        assert isinstance(self.camera, (Perspective, ThinLens, PerspectiveArctan))
        half = math.radians(self.camera.fov) / 2
        half = half if isinstance(self.camera, PerspectiveArctan) else math.tan(half)
        return (half, half / aspect) if self.camera.fov_axis == "x" else (aspect * half, half)

    def ray(self, x: float, y: float) -> tuple[Vector, Vector]:
        """Origin (3,) and unit direction (3,) of the ray through a position; it starts where the camera's clipping says."""
        assert not isinstance(self.camera, CustomCamera)
        (forward, right, up), middle = self._axes, self._middle
        across = 2 * (x - middle[0]) / self.width * self._half[0]
        upwards = 2 * (middle[1] - y) / self.height * self._half[1]
        if isinstance(self.camera, PerspectiveArctan):
            across, upwards = arctan_slope(across), arctan_slope(upwards)
        sideways, eye = across * right + upwards * up, np.array(self.camera.eye)
        if isinstance(self.camera, Orthographic):
            origin, direction = eye + sideways, forward
        else:
            origin, direction = eye, unit(forward + sideways)
        near = 0.0 if isinstance(self.camera, PerspectiveArctan) else self.camera.clip[0]
        return (origin + near / float(direction @ forward) * direction if near > 0 else origin), direction

    def reach(self, direction: Vector) -> float:
        """How long the camera's ray along a unit direction is, inf unless the camera clips it."""
        assert not isinstance(self.camera, CustomCamera)
        if isinstance(self.camera, PerspectiveArctan):
            return math.inf
        near, far = self.camera.clip
        return (far - near) / float(direction @ self._axes[0])

    def project(self, point: Vector) -> tuple[float, float] | None:
        """The position of a point, which may be outside the image; None behind the camera."""
        assert not isinstance(self.camera, CustomCamera)
        forward, right, up = self._axes
        away = np.asarray(point, np.float64) - np.array(self.camera.eye)
        depth = float(away @ forward)
        across, upwards = float(away @ right), float(away @ up)
        if not isinstance(self.camera, Orthographic):
            if depth <= 0:
                return None
            across, upwards = across / depth, upwards / depth
        if isinstance(self.camera, PerspectiveArctan):
            angles = np.linspace(-3.0, 3.0, 4001)
            slopes = [arctan_slope(angle) for angle in angles]
            across, upwards = float(np.interp(across, slopes, angles)), float(np.interp(upwards, slopes, angles))
        half, middle = self._half, self._middle
        return middle[0] + across / half[0] * self.width / 2, middle[1] - upwards / half[1] * self.height / 2

    def point_on_view_plane(self, point: Vector, x: float, y: float) -> Vector:
        """The point (3,) at position (x, y) in the plane through `point` that faces the camera."""
        forward = self._axes[0]
        origin, direction = self.ray(x, y)
        t = float((np.asarray(point) - origin) @ forward) / float(direction @ forward)
        return origin + t * direction
