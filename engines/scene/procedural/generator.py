"""What a generator of shapes is: a function with options, which gives `Faces` or `Spheres`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene import fields
from engines.scene.yaml_file import Located

BYTES_PER_FACE = 250
BYTES_PER_SPHERE = 200
"""Memory at the height of generating, temporaries and the checks of the loader included."""


class Faces(NamedTuple):
    """A generated mesh: `vertices` (n, 3) float64, `faces` (m, 3) int32, counter-clockwise seen from the front."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    name: str


class Spheres(NamedTuple):
    """Generated spheres: `centers` (n, 3) and `radii` (n,), float64."""

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    name: str


@dataclass(frozen=True, slots=True)
class Option:
    """`read` turns a Located value into a plain one or raises; no `default` means that the option must be given."""

    read: Callable[[Located], Any]
    meaning: str
    default: Any = ...


@dataclass(frozen=True, slots=True)
class Generator:
    """`make(**options)` returns `Faces` or `Spheres`; `needs(options)` estimates bytes."""

    make: Callable[..., Faces | Spheres]
    options: Mapping[str, Option]
    needs: Callable[[Mapping[str, Any]], float] = lambda options: 0.0


def integer(low: int, high: int) -> Callable[[Located], int]:
    return lambda node: fields.integer(node, low, high)


def within(low: float, high: float) -> Callable[[Located], float]:
    return lambda node: fields.within(node, low, high)


def one_of(*names: str) -> Callable[[Located], str]:
    return lambda node: fields.one_of(node, names, "choice")


CENTER = Option(fields.triple, "the middle", (0.0, 0.0, 0.0))
FOOT = Option(fields.triple, "the middle of its lowest level", (0.0, 0.0, 0.0))
RADIUS = Option(fields.positive, "in metres", 1.0)
ROTATE_Y = Option(fields.number, "degrees about +y, right-handed", 0.0)


def turned(points: NDArray[np.float64], rotate_y: float) -> NDArray[np.float64]:
    """(n, 3) points turned by degrees about +y: x' = x cos + z sin, z' = z cos - x sin."""
    x, y, z = points.T
    cos, sin = np.cos(np.radians(rotate_y)), np.sin(np.radians(rotate_y))
    return np.stack([x * cos + z * sin, y, z * cos - x * sin], axis=1)


def quads(a: NDArray[np.int32], b: NDArray[np.int32], c: NDArray[np.int32], d: NDArray[np.int32]) -> NDArray[np.int32]:
    """Two faces (a, b, c) and (a, c, d) for each place in the arrays of corners."""
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def grid_faces(rows: int, columns: int) -> NDArray[np.int32]:
    """(2 rows columns, 3) faces of a grid of (rows + 1) x (columns + 1) vertices; front: row axis x column axis."""
    index = np.arange((rows + 1) * (columns + 1), dtype=np.int32).reshape(rows + 1, columns + 1)
    return quads(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
