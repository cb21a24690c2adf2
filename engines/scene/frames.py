"""Frames: two tangents of a normal, and the matrices that place what faces along one, or looks at a point."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def tangents(normal: Any) -> tuple[Array, Array]:
    """Unit vectors u, v with u x v = `normal`, a unit vector: for what looks the same however it is turned."""
    u = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)


def local_frame(normal: Any) -> tuple[Array, Array]:
    """The tangents of docs/transport.md of a unit vector: texture coordinates of disks and cylinders start from the first."""
    return _frame(normal, -1.0 if normal[2] < -0.7 else 1.0)


def mitsuba_frame(normal: Any) -> tuple[Array, Array]:
    """Mitsuba's tangents of a unit vector."""
    return _frame(normal, math.copysign(1.0, normal[2]))


def _frame(normal: Any, sign: float) -> tuple[Array, Array]:
    """Duff et al. 2017, "Building an Orthonormal Basis, Revisited"; `sign` is 1 where z must not be near -1."""
    x, y, z = (float(part) for part in normal)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([1.0 + sign * x * x * a, sign * b, -sign * x]), np.array([b, sign + y * y * a, -y])


def facing(point: Any, normal: Any, scale: float, depth: float = 1.0) -> Array:
    """(4, 4) the transform of the plane z = 0 to the one through `point`, `scale` times as large and +z to `depth` normals."""
    first, second = local_frame(normal)
    return _matrix(first * scale, second * scale, np.multiply(normal, depth), point)


def look_at(eye: Any, target: Any, up: Any) -> Array:
    """(4, 4) camera to world: +z forward, +y up, +x to the left. `up` must not be parallel to the view."""
    forward = np.subtract(target, eye)
    forward = forward / np.linalg.norm(forward)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    return _matrix(left, np.cross(forward, left), forward, eye)


def _matrix(*columns: Any) -> Array:
    """(4, 4) the affine transform of three images of axes and the origin's."""
    matrix = np.eye(4)
    matrix[:3] = np.stack(columns, axis=1)
    return matrix
