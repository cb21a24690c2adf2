"""Accelerators: rays in faces, edges and corners of boxes and cells, and every accelerator against the others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from engines.interface import Hits
from engines.scene import Mesh, Shape, Triangle
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.scenes import (
    FLOOR,
    FRONT_CAMERA,
    WHITE_SKY,
    box,
    mesh,
    normalize,
    path_tracer,
    quad,
    scene,
    sphere,
    sphere_mesh,
    triangle_soup,
    triangles,
)
from harness.verify.subject import Subject, accelerator_names
from harness.verify.tolerances import NONE_WRONG

SECTION = Section("accelerators", each_accelerator=True)
ZEROS = (0.0, -0.0, 1e-40, -1e-40)


def _floor(cells: int, z: float = 0.0) -> Mesh:
    """A square [0, 1]^2 of cells * cells quads: inner boxes meet at multiples of 1 / cells."""
    x, y = np.meshgrid(np.arange(cells + 1) / cells, np.arange(cells + 1) / cells, indexing="ij")
    k = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = [np.stack([k, k + cells + 1, k + cells + 2], -1), np.stack([k, k + cells + 2, k + 1], -1)]
    return mesh(np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], -1), np.concatenate(faces))


@SECTION.case(
    "B1",
    "Rays in faces and along edges of boxes hit the shapes in them, with components of 0, -0 and 1e-40.",
    NONE_WRONG,
    "Ize 2013",
)
def in_faces(subject: Subject) -> Iterator[Measurement]:
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
            yield measurement((hits.t != 1.0) | ~hidden, f"{name} across {'xyz'[(2 + axis) % 3]}")


@SECTION.case("B2", "Every ray from inside a box hits it; no ray from its faces outwards does.", NONE_WRONG)
def inside_out(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(2), subject.count(4000)
    renderer = subject.tracer(box())
    lattice = rng.integers(-3, 4, (n, 3)) / 4.0
    towards = rng.integers(-1, 2, (n, 3)).astype(float)
    towards[~towards.any(axis=1)] = (0.0, -0.0, 1.0)
    hits = renderer.trace(lattice, towards)
    with np.errstate(invalid="ignore"):
        off = np.abs(np.abs(lattice + hits.t[:, None] * towards).max(axis=1) - 1) > 8 * subject.eps
    yield measurement(np.isinf(hits.t) | off, "along axes and diagonals from a lattice")
    faces = rng.uniform(-1, 1, (n, 3))
    axis, side = rng.integers(3, size=n), rng.choice([-1.0, 1.0], n)
    faces[np.arange(n), axis] = side * (1 + 4 * subject.eps)
    out = rng.normal(size=(n, 3))
    out[np.arange(n), axis] = side * np.abs(out[np.arange(n), axis])
    faces, out = subject.cast(faces), subject.cast(out)
    yield measurement(np.isfinite(renderer.trace(faces, out).t) | renderer.occluded(faces, out), "outwards")


def _hard_scenes(subject: Subject) -> Iterator[tuple[str, list[Shape]]]:
    """(name, shapes) of scenes that are hard for trees: overlaps, duplicates, flat, huge beside small."""
    rng = np.random.default_rng(12)
    n = 300 if subject.quick else 1000
    pair = [Triangle((0.0, 0.0, 0.5), (1.0, 0.0, 0.5), (0.0, 1.0, 0.5), 0), UNIT_UP]
    big = quad(1e6 * np.array([[-1, -1, 0.0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
    same = rng.normal(size=(n, 3, 3))
    line = 0.05 * rng.normal(size=(n, 3, 3)) + np.linspace(0, 1, n)[:, None, None] * (1.0, 0.0, 0.0)
    yield "1 triangle", [UNIT_UP]
    yield "2 overlapping", [*pair]
    yield (
        "a point and a line beside one",
        [triangles(np.full((1, 3, 3), 0.25)), triangles(np.arange(3.0)[None, :, None] * np.ones(3)), UNIT_UP],
    )
    yield "random", [triangle_soup(n, 0.2)]
    yield "small beside huge", [mesh(1e-3 * triangle_soup(20, 1.0).vertices + 0.5, triangle_soup(20, 1.0).faces), big]
    yield "equal centroids", [triangles(same - same.mean(axis=1, keepdims=True))]
    yield "on a line", [triangles(line)]
    yield "duplicates", [triangles(np.tile(same[:1] * 0.4, (10 * n if subject.accelerator != "none" else n, 1, 1)))]
    yield "flat", [_floor(12)]
    yield ("all kinds", [sphere_mesh(8, (0.5, 0.5, 0.5), 0.3), FLOOR, sphere((0.2, 0.8, 0.1), 0.25), sphere((1, 1, 1), 0.5)])


UNIT_UP = Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)


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


@SECTION.case(
    "A1", "Every accelerator gives the same hits, with t equal bit for bit, on scenes that are hard for trees.", NONE_WRONG
)
def same_hits(subject: Subject) -> Iterator[Measurement]:
    """Compares with the engine's first accelerator; where there is no other, `occluded` with `trace`."""
    first = accelerator_names(subject.engine)[0]
    for name, uncast in _hard_scenes(subject):
        shapes = _cast_meshes(subject, uncast)
        origins, directions = _rays(subject, shapes, subject.count(1600))
        renderer = subject.tracer(*shapes)
        hits = renderer.trace(origins, directions)
        wrong = renderer.occluded(origins, directions) != np.isfinite(hits.t)
        if subject.accelerator != first:
            wrong |= _differences(hits, subject.tracer(*shapes, accelerator=first).trace(origins, directions))
        yield measurement(wrong, name)


def _cast_meshes(subject: Subject, shapes: list[Shape]) -> list[Shape]:
    return [mesh(subject.cast(shape.vertices), shape.faces) if isinstance(shape, Mesh) else shape for shape in shapes]


@SECTION.case("A2", "Rays along the walls and through the corners of grid cells hit, and every traversal ends.", NONE_WRONG)
def cell_walls(subject: Subject) -> Iterator[Measurement]:
    layers = [_floor(8, float(z)) for z in (-1.0, -0.5, 0.0)]
    rng, n = np.random.default_rng(22), subject.count(4000)
    targets = np.append(rng.integers(1, 8, (n, 2)) / 8.0, np.zeros((n, 1)), axis=1)
    directions = np.append(rng.integers(-2, 3, (n, 2)) / 8.0, -np.ones((n, 1)), axis=1)
    for away in (1.0, 64.0):
        hits = subject.trace(list(layers), targets - away * directions, directions)
        yield measurement((np.abs(hits.t / away - 1) > 16 * subject.eps) | (hits.shape != 2), f"from {away:g}")


@SECTION.case("A7", "Hits do not depend on the options of an accelerator, such as a grid of one cell.", NONE_WRONG)
def any_resolution(subject: Subject) -> Iterator[Measurement]:
    """Compares with the engine's first accelerator, for the extreme values of all numeric options."""
    first, n = accelerator_names(subject.engine)[0], subject.count(1600)
    scenes: list[list[Shape]] = [[UNIT_UP], [_floor(8)], [triangle_soup(60, 0.3)], [*(_floor(4, z) for z in (-1.0, -0.5, 0.0))]]
    for option, value in _extremes(subject):
        chosen, wrong = {"name": subject.accelerator, option: value}, np.zeros(0, bool)
        for uncast in scenes:
            shapes = _cast_meshes(subject, uncast)
            origins, directions = _rays(subject, shapes, n)
            hits = subject.tracer(*shapes, accelerator=chosen).trace(origins, directions)
            expected = subject.tracer(*shapes, accelerator=first).trace(origins, directions)
            wrong = np.append(wrong, _differences(hits, expected))
        yield measurement(wrong, f"{option} {value:g}")


def _extremes(subject: Subject) -> Iterator[tuple[str, float]]:
    """(option, value): the smallest and the largest power of ten that each numeric option accepts."""
    for name, option in subject.engine.accelerators()[subject.accelerator].items():
        if isinstance(option.default, (int, float)) and not isinstance(option.default, bool):
            powers = [type(option.default)(10.0**power) for power in range(-3, 4)]
            taken = [value for value in powers if option.check(value) is None]
            yield from ((name, value) for value in dict.fromkeys([*taken[:1], *taken[-1:]]))


@SECTION.case("A3", "A hit beyond the current cell does not hide a nearer one.", NONE_WRONG)
def not_early(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(33), subject.count(2000)
    slope = Triangle((-1.0, -1.0, -4.0), (3.0, -1.0, -4.0), (1.0, 3.0, 4.0), 0)
    dots = triangles(subject.cast(rng.random((200, 1, 3)) + 0.02 * rng.normal(size=(200, 3, 3))))
    origins = subject.cast(rng.uniform(-1, 2, (n, 3)))
    directions = subject.cast(rng.random((n, 3)) - origins)
    both = subject.trace([slope, dots], origins, directions)
    parts = [subject.trace([shape], origins, directions).t for shape in (slope, dots)]
    nearer = np.minimum(*parts)
    with np.errstate(invalid="ignore"):
        yield measurement((both.t != nearer) & ~(np.abs(both.t - nearer) <= 32 * subject.eps * np.minimum(nearer, 10)))


@SECTION.case("A4", "Primitives at distances 2^-k, each half as large as the last, are all hit.", NONE_WRONG)
def geometric(subject: Subject) -> Iterator[Measurement]:
    sizes = 2.0 ** -np.arange(0, 60 if subject.tracing == "float64" else 30)
    corners = sizes[:, None, None] * np.array([[1.0, 0, 0], [1.0, 0.5, 0], [1.0, 0, 0.5]])
    aim = sizes[:, None] * (1.0, 0.125, 0.125)
    hits = subject.trace([triangles(corners)], aim + sizes[:, None] * (0.25, 0, 0), np.tile([-1.0, 0, 0], (len(aim), 1)))
    yield measurement((hits.primitive != np.arange(len(aim))) | (np.abs(hits.t / (0.25 * sizes) - 1) > 64 * subject.eps))


@SECTION.case("A5", "Infinite planes are hit far from the origin, also beside a mesh.", NONE_WRONG, "MobileRT M13")
def planes(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(55), subject.count(2000)
    away = normalize(rng.normal(size=(n, 3))) * 10.0 ** rng.uniform(0, 4, (n, 1))
    origins = subject.cast(away * (1, 0, 1) + (0, 2, 0))
    hits = subject.trace([FLOOR, sphere_mesh(10, (0.0, -50.0, 0.0))], origins, np.tile([0.0, -1.0, 0.0], (n, 1)))
    yield measurement((hits.t != 2.0) | (hits.shape != 0))


@SECTION.case("A6", "Two builds, and renders with one and two threads, give the same bytes.", NONE_WRONG)
def same_bytes(subject: Subject) -> Iterator[Measurement]:
    held = scene([triangle_soup(200, 0.3), FLOOR], lights=[WHITE_SKY], camera=FRONT_CAMERA)
    films = [subject.renderer(held, shader=path_tracer(3), threads=k, seed=5).render(2) for k in (1, 1, 2)]
    yield measurement([not np.array_equal(films[0].sums, film.sums) for film in films[1:]])
