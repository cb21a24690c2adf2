"""Textures and texture coordinates: a matt surface under a white sky shows its reflectance to the pixel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene import (
    Checkerboard,
    Cylinder,
    Diffuse,
    Disk,
    ImageTexture,
    Mesh,
    Orthographic,
    Plane,
    Shape,
    Sphere,
    Texture,
    Triangle,
)
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.checks.models import RAMP, panel
from harness.verify.scenes import WHITE_SKY, material, path_tracer
from harness.verify.subject import Skipped, Subject
from harness.verify.tolerances import Tolerance

SECTION = Section("textures")
SIDE = 37
"""Pixels along an image: prime, so that few centres of pixels lie on edges of texels."""
TEXELS = np.random.default_rng(5).random((5, 7)).astype(np.float32)
PLACES: dict[str, tuple[float, ...]] = {
    "as it is": (1, 0, 0, 0, 1, 0),
    "scaled": (2.3, 0, -0.61, 0, -1.7, 0.27),
    "turned": (0.8, -1.1, 0.3, 0.9, 1.2, -0.45),
}


def _shown(subject: Subject, shapes: Sequence[Shape], textures: Sequence[Texture], x: float, half: float) -> Array:
    """(SIDE, SIDE) as seen from above around (x, 0, 0), upwards in the image to -z: the reflectance of what is seen."""
    camera = Orthographic((x, 8.0, 0.0), (x, 0.0, 0.0), (0.0, 0.0, -1.0), 2 * half, (SIDE, SIDE))
    materials = [material(bsdf=Diffuse(texture)) for texture in textures]
    return subject.image(shapes, materials, [WHITE_SKY], camera, path_tracer(2, "light"), sampler="constant")


def _window(half: float) -> tuple[Array, Array]:
    """x from the middle and -z of the pixels' centres, (SIDE, SIDE)."""
    places = half * (2 * (np.arange(SIDE) + 0.5) / SIDE - 1)
    return np.broadcast_to(places, (SIDE, SIDE)), np.broadcast_to(-places[:, None], (SIDE, SIDE))


def _texel(i: float, size: int, wrap: str) -> int:
    if wrap == "clamp":
        return min(max(int(i), 0), size - 1)
    if wrap == "repeat":
        return int(i) % size
    i = int(i) % (2 * size)
    return i if i < size else 2 * size - 1 - i


def looked_up(texture: ImageTexture, u: float, v: float) -> float:
    """A texture of one channel at (u, v)."""
    m, (height, width) = texture.to_uv, texture.pixels.shape[:2]
    x, y = (m[0] * u + m[1] * v + m[2]) * width, (m[3] * u + m[4] * v + m[5]) * height

    def at(i: float, j: float) -> float:
        return float(texture.pixels[_texel(j, height, texture.wrap), _texel(i, width, texture.wrap), 0])

    if texture.filter == "nearest":
        return at(math.floor(x), math.floor(y))
    left, top = math.floor(x - 0.5), math.floor(y - 0.5)
    fx, fy = x - 0.5 - left, y - 0.5 - top
    weights = ((1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy)
    return sum(w * at(left + k % 2, top + k // 2) for k, w in enumerate(weights))


@SECTION.case(
    "tex",
    "An image shows its texels by filter, wrap and transform; a checkerboard its squares.",
    Tolerance("absolute", 1e-9, 1e-4, "texels differ by up to 1, and a place is rounded to 1e-6 of a texel"),
    "docs/transport.md",
)
def textured(subject: Subject) -> Iterator[Measurement]:
    """A panel with (u, v) from 0 to 1; v = 0 is its lower edge in the picture, and the upper row of the texture."""
    x, up = _window(0.5)
    u, v = x + 0.5, up + 0.5
    placed: Mesh = panel(-0.5, 0)
    square = Mesh(placed.vertices - (0.0, 0.0, 0.5), placed.faces, placed.materials, uvs=placed.uvs)
    for filter in ("bilinear", "nearest"):
        for wrap in ("repeat", "mirror", "clamp"):
            for name, place in PLACES.items():
                texture = ImageTexture(TEXELS[:, :, None], filter, wrap, place)  # type: ignore[arg-type]
                truth, clear = _truth(np.vectorize(lambda a, b, texture=texture: looked_up(texture, a, b)), u, v)
                errors = _shown(subject, [square], [texture], 0.0, 0.5) - truth
                yield measurement(errors[clear], f"{filter}, {wrap}, {name}")
    for name, m in PLACES.items():
        truth, clear = _truth(lambda a, b, m=m: _squares(m, a, b), u, v)
        board = Checkerboard((0.7, 0.7, 0.7), (0.1, 0.1, 0.1), m)  # type: ignore[arg-type]
        errors = _shown(subject, [square], [board], 0.0, 0.5) - truth
        yield measurement(errors[clear], f"checkerboard, {name}")


def _squares(m: tuple[float, ...], u: Array, v: Array) -> Array:
    first = [(m[3 * k] * u + m[3 * k + 1] * v + m[3 * k + 2]) % 1.0 > 0.5 for k in (0, 1)]
    return np.where(first[0] == first[1], 0.7, 0.1)


def _truth(shown: Callable[[Array, Array], Array], u: Array, v: Array) -> tuple[Array, NDArray[np.bool_]]:
    """A texture at (u, v), and where it is clear: no edge lies so near that rounding decides."""
    truth, near = shown(u, v), 1e-5
    around = [shown(u + i * near, v + j * near) for i in (-1, 1) for j in (-1, 1)]
    return truth, np.logical_and.reduce([np.abs(each - truth) < 1e-2 for each in around], axis=0)


CYLINDER = Cylinder((-0.6, 0.0, 0.1), (0.8, 0.0, -0.3), 0.5, 0)
PLANE = Plane((0.25, 0.0, 0.4), (0.0, 1.0, 0.0), 0)
CORNERS = np.array([(-0.9, 0.0, 0.8), (0.9, 0.2, 0.6), (-0.1, -0.1, -0.9)])
VERTEX_UVS = np.array([(0.1, 0.9), (0.7, 0.2), (0.9, 0.8)])


def _duff(n: Array) -> tuple[Array, Array]:
    """(t1, t2) of a unit normal (Duff et al. 2017)."""
    sign = -1.0 if n[2] < -0.7 else 1.0
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    return np.array([1 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]]), np.array([b, sign + n[1] ** 2 * a, -n[1]])


def _turn(y: Array, x: Array) -> Array:
    return np.arctan2(y, x) / (2 * math.pi) % 1.0


def _on_triangle(x: Array, z: Array) -> tuple[Array, Array]:
    """(b1, b2) of the triangle CORNERS below (x, z)."""
    (ax, _, az), (bx, _, bz), (cx, _, cz) = CORNERS
    det = (bx - ax) * (cz - az) - (cx - ax) * (bz - az)
    return ((x - ax) * (cz - az) - (cx - ax) * (z - az)) / det, ((bx - ax) * (z - az) - (x - ax) * (bz - az)) / det


def _mesh(x: Array, z: Array) -> tuple[Array, Array]:
    b1, b2 = _on_triangle(x, z)
    return tuple((1 - b1 - b2) * a + b1 * b + b2 * c for a, b, c in zip(*VERTEX_UVS, strict=True))  # type: ignore[return-value]


def _sphere(x: Array, z: Array) -> tuple[Array, Array]:
    return _turn(np.sqrt(np.maximum(1 - x * x - z * z, 0)), x), np.arccos(np.clip(z, -1, 1)) / math.pi


def _disk(x: Array, z: Array) -> tuple[Array, Array]:
    t1, t2 = _duff(np.array([0.0, 1.0, 0.0]))
    return np.hypot(x, z), _turn(x * t2[0] + z * t2[2], x * t1[0] + z * t1[2])


def _cylinder(x: Array, z: Array) -> tuple[Array, Array]:
    p0, p1 = np.array(CYLINDER.p0), np.array(CYLINDER.p1)
    length = float(np.linalg.norm(p1 - p0))
    axis = (p1 - p0) / length
    t1, t2 = _duff(axis)
    along = (x - p0[0]) * axis[0] + (z - p0[2]) * axis[2]
    from_axis2 = (x - p0[0]) ** 2 + (z - p0[2]) ** 2 - along**2
    y = np.sqrt(np.maximum(CYLINDER.radius**2 - from_axis2, 0))
    away = np.stack([x - p0[0] - along * axis[0], y, z - p0[2] - along * axis[2]])
    return _turn(np.einsum("i,ijk", t2, away), np.einsum("i,ijk", t1, away)), along / length


def _plane(x: Array, z: Array) -> tuple[Array, Array]:
    t1, t2 = _duff(np.array(PLANE.normal))
    return (x - 0.25) * t1[0] + (z - 0.4) * t1[2], (x - 0.25) * t2[0] + (z - 0.4) * t2[2]


def _sheet(uvs: Any) -> Mesh:
    return Mesh(CORNERS.copy(), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), uvs=uvs)


_A, _B, _C = ((float(x), float(y), float(z)) for x, y, z in CORNERS)
SHAPES: dict[str, tuple[Shape, float, Callable[[Array, Array], tuple[Array, Array]]]] = {
    "triangle": (Triangle(_A, _B, _C, 0), 0.25, _on_triangle),
    "mesh": (_sheet(None), 0.25, _on_triangle),
    "mesh with uvs": (_sheet(VERTEX_UVS), 0.25, _mesh),
    "sphere": (Sphere((0.0, 0.0, 0.0), 1.0, 0), 0.45, _sphere),
    "disk": (Disk((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, 0), 0.65, _disk),
    "cylinder": (CYLINDER, 0.2, _cylinder),
    "plane": (PLANE, 0.2, _plane),
}
"""The shape at the origin, half the side of what is seen of it, and (u, v) below (x, z)."""


@SECTION.case(
    "uv",
    "Every shape has the texture coordinates of docs/transport.md.",
    Tolerance("absolute", 1e-9, 1e-5),
    "docs/transport.md",
)
def coordinates(subject: Subject) -> Iterator[Measurement]:
    """Textures that rise linearly with u, and with v, from 0 to 1."""
    rise = {"u": np.array([[0.0, 1.0], [0.0, 1.0]], np.float32), "v": np.array([[0.0, 0.0], [1.0, 1.0]], np.float32)}
    reasons, tested = [], False
    for name, (shape, half, place) in SHAPES.items():
        x, up = _window(half)
        for k, (coordinate, pixels) in enumerate(rise.items()):
            texture = ImageTexture(pixels[:, :, None], wrap="clamp", to_uv=RAMP)
            truth = np.clip(place(x, -up)[k], 0, 1)
            try:
                seen = _shown(subject, [shape], [texture], 0.0, half)
            except Skipped as reason:
                reasons.append(reason)
                break
            tested = True
            yield measurement((seen - truth).ravel(), f"{name}, {coordinate}")
    if not tested:
        raise reasons[0]
