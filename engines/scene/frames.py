"""Frames: two tangents of a normal, and the matrices that place what faces along one, or looks at a point; what is asked of
matrices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]
"""(4, 4), or (3, 3) for its linear part."""
LARGEST = 1e30
"""What the numbers of transforms, coordinates and emission must stay below: their squares and cubes are finite."""


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


def nearest_orthogonal(linear: Matrix) -> Matrix:
    """The orthogonal matrix nearest to a linear part (k, k)."""
    left, _, right = np.linalg.svd(linear)
    return left @ right


def cofactors(linear: Matrix) -> Matrix:
    """(..., 3, 3) det(A) A^-T, for normals, also where A has no inverse. Times the sign of det(A) it keeps their side."""
    one, two = linear[..., [1, 2, 0], :], linear[..., [2, 0, 1], :]
    return one[..., [1, 2, 0]] * two[..., [2, 0, 1]] - one[..., [2, 0, 1]] * two[..., [1, 2, 0]]


def placed(to_world: Matrix, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) points of the scene."""
    return points @ to_world[:3, :3].T + to_world[:3, 3]


def mirrored(to_world: Matrix) -> bool:
    """Whether a transform exchanges left and right."""
    return bool(np.linalg.det(to_world[:3, :3]) < 0.0)
