"""Boxes and accelerators: rays in faces, edges and corners of boxes and cells, and every tree against every other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.interface import Hits
from engines.scene import Mesh, Shape, Triangle
from harness.verify.case import Array, Measured, Section, measured
from harness.verify.stage import AHEAD, FLOOR, SKY, ball, box, mesh, path_tracer, quad, scene, soup, sphere, unit
from harness.verify.subject import Subject, accelerators

SECTION = Section("boxes and trees", each_accelerator=True)
ZEROS = (0.0, -0.0, 1e-40, -1e-40)


def _floor(cells: int, z: float = 0.0) -> Mesh:
    """A square [0, 1]^2 of cells * cells quads: inner boxes meet at whole multiples of 1 / cells."""
    x, y = np.meshgrid(np.arange(cells + 1) / cells, np.arange(cells + 1) / cells, indexing="ij")
    k = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = [np.stack([k, k + cells + 1, k + cells + 2], -1), np.stack([k, k + cells + 2, k + 1], -1)]
    return mesh(np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], -1), np.concatenate(faces))


@SECTION.case("B1", "Rays in faces and along edges of boxes hit what the boxes hold, from 0, -0 and 1e-40 alike.",
              "Ize 2013")  # fmt: skip
def in_faces(subject: Subject) -> Iterator[Measured]:
    cells = 16
    inner = np.arange(1, cells) / cells
    x, y = (part.ravel() for part in np.meshgrid(inner, inner))
    slants = np.array([(dx, dy, -1.0) for dx in ZEROS for dy in ZEROS])
    origins = np.tile(np.stack([x, y, np.ones(x.size)], -1), (len(slants), 1))
    directions = np.repeat(slants, x.size, axis=0)
    shapes: dict[str, list[Mesh]] = {"flat": [_floor(cells)], "cube": [_floor(cells), _floor(cells, -1.0)]}
    for name, held in shapes.items():
        for axis in range(3):
            order = np.roll(np.arange(3), axis)
            renderer = subject.tracer(*(mesh(m.vertices[:, order], m.faces) for m in held))
            hits = renderer.trace(origins[:, order], directions[:, order])
            hidden = renderer.occluded(origins[:, order], directions[:, order])
            yield measured((hits.t != 1.0) | ~hidden, f"{name} across {'xyz'[(2 + axis) % 3]}")


@SECTION.case("B2", "From inside a box every ray hits; from its faces outwards none does.", "raybench")
def inside_out(subject: Subject) -> Iterator[Measured]:
    rng, n = np.random.default_rng(2), subject.count(4000)
    renderer = subject.tracer(box())
    lattice = rng.integers(-3, 4, (n, 3)) / 4.0
    towards = rng.integers(-1, 2, (n, 3)).astype(float)
    towards[~towards.any(axis=1)] = (0.0, -0.0, 1.0)
    hits = renderer.trace(lattice, towards)
    with np.errstate(invalid="ignore"):
        off = np.abs(np.abs(lattice + hits.t[:, None] * towards).max(axis=1) - 1) > 8 * subject.eps
    yield measured(np.isinf(hits.t) | off, "along axes and diagonals from a lattice")
    faces = rng.uniform(-1, 1, (n, 3))
    axis, side = rng.integers(3, size=n), rng.choice([-1.0, 1.0], n)
    faces[np.arange(n), axis] = side * (1 + 4 * subject.eps)
    out = rng.normal(size=(n, 3))
    out[np.arange(n), axis] = side * np.abs(out[np.arange(n), axis])
    faces, out = subject.cast(faces), subject.cast(out)
    yield measured(np.isfinite(renderer.trace(faces, out).t) | renderer.occluded(faces, out), "outwards")


def _nasty(subject: Subject) -> Iterator[tuple[str, list[Shape]]]:
    """The scenes that trees trip over."""
    rng = np.random.default_rng(12)
    n = 300 if subject.quick else 1000
    pair = [Triangle((0.0, 0.0, 0.5), (1.0, 0.0, 0.5), (0.0, 1.0, 0.5), 0), UNIT_UP]
    big = quad(1e6 * np.array([[-1, -1, 0.0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
    same = rng.normal(size=(n, 3, 3))
    line = 0.05 * rng.normal(size=(n, 3, 3)) + np.linspace(0, 1, n)[:, None, None] * (1.0, 0.0, 0.0)
    yield "1 triangle", [UNIT_UP]
    yield "2 overlapping", [*pair]
    yield "a point and a line beside one", [_triangles(np.full((1, 3, 3), 0.25)),
                                            _triangles(np.arange(3.0)[None, :, None] * np.ones(3)), UNIT_UP]  # fmt: skip
    yield "random", [soup(n, 0.2)]
    yield "small beside huge", [mesh(1e-3 * soup(20, 1.0).vertices + 0.5, soup(20, 1.0).faces), big]
    yield "equal centroids", [_triangles(same - same.mean(axis=1, keepdims=True))]
    yield "on a line", [_triangles(line)]
    yield "duplicates", [_triangles(np.tile(same[:1] * 0.4, (10 * n if subject.accelerator != "none" else n, 1, 1)))]
    yield "flat", [_floor(12)]
    yield "all kinds", [ball(8, (0.5, 0.5, 0.5), 0.3), FLOOR, sphere((0.2, 0.8, 0.1), 0.25), sphere((1, 1, 1), 0.5)]


UNIT_UP = Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)


def _triangles(corners: NDArray[Any]) -> Mesh:
    return mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _rays(subject: Subject, shapes: list[Shape], n: int) -> tuple[Array, Array]:
    """Random rays, axis-aligned ones through a lattice, and rays aimed at vertices."""
    rng = np.random.default_rng(13)
    origins = rng.uniform(-1, 2, (3 * n, 3))
    directions = rng.normal(size=(3 * n, 3))
    origins[n : 2 * n] = rng.integers(-4, 9, (n, 3)) / 4.0
    directions[n : 2 * n] = np.eye(3)[rng.integers(3, size=n)] * rng.choice([-1.0, 1.0], (n, 1))
    meshes = [shape.vertices for shape in shapes if isinstance(shape, Mesh)]
    origins = subject.cast(origins)
    if meshes:
        points = np.concatenate(meshes)
        directions[2 * n :] = points[rng.integers(len(points), size=n)] - origins[2 * n :]
    return origins, subject.cast(directions)


def _differences(ours: Hits, theirs: Hits) -> Array:
    return (ours.t != theirs.t) | (ours.shape != theirs.shape) | (ours.primitive != theirs.primitive)


@SECTION.case("A1", "Every accelerator gives the same hits, t bit for bit, on scenes that trees trip over.",
              "raybench, A1")  # fmt: skip
def same_hits(subject: Subject) -> Iterator[Measured]:
    """Against the engine's first accelerator; where there is no other, `occluded` against `trace`."""
    first = accelerators(subject.engine)[0]
    for name, nasty in _nasty(subject):
        shapes = _cast_meshes(subject, nasty)
        origins, directions = _rays(subject, shapes, subject.count(1600))
        renderer = subject.tracer(*shapes)
        hits = renderer.trace(origins, directions)
        wrong = renderer.occluded(origins, directions) != np.isfinite(hits.t)
        if subject.accelerator != first:
            wrong |= _differences(hits, subject.tracer(*shapes, accelerator=first).trace(origins, directions))
        yield measured(wrong, name)


def _cast_meshes(subject: Subject, shapes: list[Shape]) -> list[Shape]:
    return [mesh(subject.cast(shape.vertices), shape.faces) if isinstance(shape, Mesh) else shape for shape in shapes]


@SECTION.case("A2", "Rays along cell walls and through cell corners hit, whatever the grid; nothing loops.",
              "raybench, A2")  # fmt: skip
def cell_walls(subject: Subject) -> Iterator[Measured]:
    layers = [_floor(8, float(z)) for z in (-1.0, -0.5, 0.0)]
    rng, n = np.random.default_rng(22), subject.count(4000)
    targets = np.append(rng.integers(1, 8, (n, 2)) / 8.0, np.zeros((n, 1)), axis=1)
    directions = np.append(rng.integers(-2, 3, (n, 2)) / 8.0, -np.ones((n, 1)), axis=1)
    for away in (1.0, 64.0):
        hits = subject.trace(list(layers), targets - away * directions, directions)
        yield measured((np.abs(hits.t / away - 1) > 16 * subject.eps) | (hits.shape != 2), f"from {away:g}")


@SECTION.case("A7", "However coarse or fine an accelerator is told to be, down to one cell, its hits are the same.",
              "raybench, A2: resolution 1")  # fmt: skip
def any_resolution(subject: Subject) -> Iterator[Measured]:
    """Against the engine's first accelerator, over all options that are numbers."""
    first, n = accelerators(subject.engine)[0], subject.count(1600)
    scenes: list[list[Shape]] = [[UNIT_UP], [_floor(8)], [soup(60, 0.3)], [*(_floor(4, z) for z in (-1.0, -0.5, 0.0))]]
    for option, value in _extremes(subject):
        chosen, wrong = {"name": subject.accelerator, option: value}, np.zeros(0, bool)
        for given in scenes:
            shapes = _cast_meshes(subject, given)
            origins, directions = _rays(subject, shapes, n)
            hits = subject.tracer(*shapes, accelerator=chosen).trace(origins, directions)
            expected = subject.tracer(*shapes, accelerator=first).trace(origins, directions)
            wrong = np.append(wrong, _differences(hits, expected))
        yield measured(wrong, f"{option} {value:g}")


def _extremes(subject: Subject) -> Iterator[tuple[str, float]]:
    """The smallest and the largest power of ten that each option of the accelerator takes."""
    for name, option in subject.engine.accelerators()[subject.accelerator].items():
        if isinstance(option.default, (int, float)) and not isinstance(option.default, bool):
            powers = [type(option.default)(10.0**power) for power in range(-3, 4)]
            taken = [value for value in powers if option.check(value) is None]
            yield from ((name, value) for value in dict.fromkeys([*taken[:1], *taken[-1:]]))


@SECTION.case("A3", "A hit beyond the current cell is not taken before a nearer one.", "raybench, A3")
def not_early(subject: Subject) -> Iterator[Measured]:
    rng, n = np.random.default_rng(33), subject.count(2000)
    slope = Triangle((-1.0, -1.0, -4.0), (3.0, -1.0, -4.0), (1.0, 3.0, 4.0), 0)
    dots = _triangles(subject.cast(rng.random((200, 1, 3)) + 0.02 * rng.normal(size=(200, 3, 3))))
    origins = subject.cast(rng.uniform(-1, 2, (n, 3)))
    directions = subject.cast(rng.random((n, 3)) - origins)
    both = subject.trace([slope, dots], origins, directions)
    parts = [subject.trace([shape], origins, directions).t for shape in (slope, dots)]
    nearer = np.minimum(*parts)
    with np.errstate(invalid="ignore"):
        yield measured((both.t != nearer) & ~(np.abs(both.t - nearer) <= 32 * subject.eps * np.minimum(nearer, 10)))


@SECTION.case("A4", "Primitives at 2^-k, each half as far as the last, are built and hit.", "raybench, A4")
def geometric(subject: Subject) -> Iterator[Measured]:
    sizes = 2.0 ** -np.arange(0, 60 if subject.tracing == "float64" else 30)
    corners = sizes[:, None, None] * np.array([[1.0, 0, 0], [1.0, 0.5, 0], [1.0, 0, 0.5]])
    aim = sizes[:, None] * (1.0, 0.125, 0.125)
    hits = subject.trace(
        [_triangles(corners)], aim + sizes[:, None] * (0.25, 0, 0), np.tile([-1.0, 0, 0], (len(aim), 1))
    )
    yield measured((hits.primitive != np.arange(len(aim))) | (np.abs(hits.t / (0.25 * sizes) - 1) > 64 * subject.eps))


@SECTION.case("A5", "Infinite planes are hit everywhere, tilted ones too, beside a mesh in a tree.", "MobileRT M13")
def planes(subject: Subject) -> Iterator[Measured]:
    rng, n = np.random.default_rng(55), subject.count(2000)
    away = unit(rng.normal(size=(n, 3))) * 10.0 ** rng.uniform(0, 4, (n, 1))
    origins = subject.cast(away * (1, 0, 1) + (0, 2, 0))
    hits = subject.trace([FLOOR, ball(10, (0.0, -50.0, 0.0))], origins, np.tile([0.0, -1.0, 0.0], (n, 1)))
    yield measured((hits.t != 2.0) | (hits.shape != 0))


@SECTION.case("A6", "Two builds, and one or two threads, give the same image bytes.", "raybench, A6")
def same_bytes(subject: Subject) -> Iterator[Measured]:
    held = scene([soup(200, 0.3), FLOOR], lights=[SKY], camera=AHEAD)
    films = [subject.prepared(held, shader=path_tracer(3), threads=k, seed=5).render(2) for k in (1, 1, 2)]
    yield measured([not np.array_equal(films[0].sums, film.sums) for film in films[1:]])
