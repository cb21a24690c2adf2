"""Scenes of a few shapes, built in code: meshes, materials, and cameras that see one point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.scene import (
    EnvironmentLight,
    HomogeneousMedium,
    Light,
    Material,
    Mesh,
    Perspective,
    Plane,
    Scene,
    Shape,
    Sphere,
    Triangle,
)

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
ORIGIN: Triple = (0.0, 0.0, 0.0)
FRONT_CAMERA = Perspective((0.0, 0.0, 5.0), ORIGIN, (0.0, 1.0, 0.0), 40.0, "y", (8, 8))
WHITE_SKY = EnvironmentLight((1.0, 1.0, 1.0))
FLOOR = Plane(ORIGIN, (0.0, 1.0, 0.0), 0)
UNIT_TRIANGLE = Triangle(ORIGIN, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)


def grey(level: float) -> Triple:
    return float(level), float(level), float(level)


def as_tuple(values: ArrayLike) -> Triple:
    x, y, z = np.asarray(values, np.float64)
    return float(x), float(y), float(z)


def material(kd: float = 0.0, ks: float = 0.0, kt: float = 0.0, emission: float = 0.0, **more: Any) -> Material:
    return Material("m", grey(kd), grey(ks), grey(kt), emission=grey(emission), **more)


def glass(ior: float = 1.5) -> Material:
    return material(ks=1, kt=1, ior=ior, fresnel=True)


def scene(
    shapes: Sequence[Shape] = (),
    materials: Sequence[Material] = (),
    lights: Sequence[Light] = (),
    camera: Any = FRONT_CAMERA,
    media: Sequence[HomogeneousMedium] = (),
) -> Scene:
    materials = tuple(materials) or (material(kd=0.5),)
    return Scene("verify", camera, materials, tuple(shapes), tuple(lights), "", media=tuple(media))


def point_view(eye: ArrayLike, target: ArrayLike, side: int = 1, up: Triple = (0.0, 1.0, 0.0)) -> Perspective:
    """A camera 0.01 degrees wide: all side * side pixels see one point and are replicates of one pixel."""
    return Perspective(as_tuple(eye), as_tuple(target), up, 0.01, "y", (side, side))


def path_tracer(max_depth: int = 2, direct: str = "mis", rr_depth: int = 1_000_000) -> dict[str, Any]:
    return {"name": "path_tracer", "max_depth": max_depth, "direct": direct, "rr_depth": rr_depth}


def whitted(max_depth: int = 6, ambient: float = 0.0) -> dict[str, Any]:
    return {"name": "whitted", "max_depth": max_depth, "ambient": ambient}


def sphere(center: ArrayLike = ORIGIN, radius: float = 1.0, index: int = 0) -> Sphere:
    return Sphere(as_tuple(center), float(radius), index)


def triangle(corners: ArrayLike, index: int = 0) -> Triangle:
    a, b, c = np.asarray(corners, np.float64)
    return Triangle(as_tuple(a), as_tuple(b), as_tuple(c), index)


def mesh(vertices: ArrayLike, faces: ArrayLike, index: int = 0) -> Mesh:
    corners, indices = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32)
    return Mesh(corners, indices, np.full(len(indices), index, np.int32))


def quad(corners: ArrayLike, index: int = 0) -> Mesh:
    """Two faces; their front is where the corners are counter-clockwise."""
    return mesh(corners, [[0, 1, 2], [0, 2, 3]], index)


def square(y: float, half: float = 0.5, index: int = 0, down: bool = False, center: float = 0.0) -> Mesh:
    """A square of side 2 half at height y around x = `center`; its front faces up, or down."""
    x0, x1 = center - half, center + half
    corners = np.array([(x0, y, half), (x1, y, half), (x1, y, -half), (x0, y, -half)])
    return quad(corners[::-1] if down else corners, index)


def box(low: ArrayLike = (-1, -1, -1), high: ArrayLike = (1, 1, 1), index: int = 0) -> Mesh:
    """A box of twelve triangles, counter-clockwise from outside."""
    ends = np.array([low, high], np.float64)
    corners = [[ends[i >> k & 1, k] for k in range(3)] for i in range(8)]
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return mesh(corners, [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], index)


def sphere_mesh(rings: int, center: ArrayLike = ORIGIN, radius: float = 1.0, index: int = 0) -> Mesh:
    """A closed sphere of 4 rings (rings - 1) triangles, counter-clockwise from outside."""
    theta, phi = np.linspace(0.0, np.pi, rings + 1)[1:-1], np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    out = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    out = np.concatenate([out, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    row, column = np.meshgrid(np.arange(rings - 2), np.arange(2 * rings), indexing="ij")
    after = (column + 1) % (2 * rings)
    a, b = row * 2 * rings + column, row * 2 * rings + after
    c, d, k = a + 2 * rings, b + 2 * rings, np.arange(2 * rings)
    top, bottom, last = len(out) - 2, len(out) - 1, (rings - 2) * 2 * rings
    faces = [
        np.stack([a, b, d], -1).reshape(-1, 3),
        np.stack([a, d, c], -1).reshape(-1, 3),
        np.stack([np.full_like(k, top), (k + 1) % (2 * rings), k], -1),
        np.stack([np.full_like(k, bottom), last + k, last + (k + 1) % (2 * rings)], -1),
    ]
    return mesh(np.asarray(center) + radius * out, np.concatenate(faces), index)


def triangles(corners: ArrayLike) -> Mesh:
    """Separate triangles of these corners (n, 3, 3)."""
    vertices = np.reshape(corners, (-1, 3))
    return mesh(vertices, np.arange(len(vertices)).reshape(-1, 3))


def triangle_soup(count: int, size: float, seed: int = 0) -> Mesh:
    """Random triangles of about `size` in the unit cube."""
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + size * (rng.random((count, 3, 3)) - 0.5)
    return triangles(corners)


def normalize(vectors: ArrayLike) -> Array:
    """Unit vectors (..., 3)."""
    values = np.asarray(vectors, np.float64)
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def direction(polar: float, azimuth: float) -> Array:
    """A unit vector (3,) from degrees; the polar angle is from +y."""
    theta, phi = math.radians(polar), math.radians(azimuth)
    return np.array([math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi)])
