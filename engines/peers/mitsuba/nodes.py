"""What descriptions for Mitsuba are made of: nested dictionaries, 4 x 4 matrices, and files that a caller places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene import Triple

Array = NDArray[Any]
Node = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Placing:
    """Where a description's data goes.

    `mesh(name, vertices, faces, normals, uvs)` gives the name of a PLY file, where normals and uvs may be None.
    `image(name, array)` of (h, w, 3) or (h, w, 1) linear values gives the keys by which Mitsuba finds it.
    """

    mesh: Callable[[str, Array, Array, Array | None, Array | None], str]
    image: Callable[[str, Array], Node]


def rgb(values: Any) -> Node:
    return {"type": "rgb", "value": [float(value) for value in values]}


def local_frame(normal: Any) -> tuple[Array, Array]:
    """Two tangents, as docs/transport.md has them: texture coordinates of disks and cylinders start from the first."""
    x, y, z = (float(part) for part in normal)
    sign = -1.0 if z < -0.7 else 1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([1.0 + sign * x * x * a, sign * b, -sign * x]), np.array([b, sign + y * y * a, -y])


def facing(point: Any, normal: Any, scale: float, depth: float = 1.0) -> Array:
    """(4, 4) the transform of the plane z = 0 to the one through `point`, `scale` times as large and +z to `depth` normals."""
    first, second = local_frame(normal)
    matrix = np.eye(4)
    matrix[:3] = np.stack([first * scale, second * scale, np.multiply(normal, depth), point], axis=1)
    return matrix


def look_at(eye: Triple, target: Triple, up: Triple) -> Array:
    """Camera to world: +z forward, +y up, +x to the left."""
    forward = np.subtract(target, eye)
    forward = forward / np.linalg.norm(forward)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, eye], axis=1)
    return matrix
