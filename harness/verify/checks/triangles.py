"""Triangles: exact hits, watertight edges, degenerate triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from engines.scene import Mesh, Triangle
from harness.trace import oracle
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.scenes import (
    FLOOR,
    UNIT_TRIANGLE,
    box,
    material,
    mesh,
    normalize,
    path_tracer,
    point_view,
    quad,
    sphere_mesh,
    square,
    triangle,
)
from harness.verify.subject import Subject
from harness.verify.tolerances import NONE_WRONG, Tolerance

SECTION = Section("triangles", each_accelerator=True)
WATERTIGHT = "Woop, Benthin and Wald 2013"
TIES = Tolerance("wrong", 0, None, "Embree may return either of two hits at the same distance")


@SECTION.case("T1", "t, barycentric coordinates and hit point are exact to the last digits.", Tolerance("eps", 16, 16))
def accurate(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(1), subject.count(1200)
    flat = rng.random((n, 2))
    flat = 0.98 * np.where(flat.sum(axis=1, keepdims=True) > 1, 1 - flat, flat) + 0.005
    origins = np.concatenate([rng.uniform(-1, 1, (n, 2)), rng.choice([-2.0, 2.0], (n, 1))], axis=1)
    origins = subject.cast(origins)
    directions = subject.cast(np.concatenate([flat, np.zeros((n, 1))], axis=1) - origins)
    hits = subject.trace([UNIT_TRIANGLE], origins, directions)
    exact = oracle.triangle(UNIT_TRIANGLE.a, UNIT_TRIANGLE.b, UNIT_TRIANGLE.c, origins, directions)
    for name in ("t", "u", "v"):
        value, truth = getattr(hits, name), getattr(exact, name)
        yield measurement(oracle.absolute(value, truth) / subject.eps, name, oracle.ulps(value, truth, subject.dtype))
    place = origins + hits.t[:, None] * directions
    truth = np.stack([exact.u, exact.v], -1)
    yield measurement(oracle.absolute(place[:, :2], truth).max(axis=1) / subject.eps, "place")


@SECTION.case("T2", "A small sphere mesh far from the origin has no holes.", NONE_WRONG, WATERTIGHT)
def far_ball(subject: Subject) -> Iterator[Measurement]:
    center, rings, n = np.array([148376.0, 1234.0, -223423.0]), 60 if subject.quick else 200, subject.count(20_000)
    if subject.accelerator == "none":  # every ray against every triangle: fewer of both
        rings, n = 24, 1000
    rng = np.random.default_rng(2)
    around = sphere_mesh(rings, center, 2.0)
    around = mesh(subject.cast(around.vertices), around.faces)
    origins = subject.cast(center + normalize(rng.normal(size=(n, 3))) * rng.random((n, 1)))
    yield measurement(np.isinf(subject.trace([around], origins, subject.cast(rng.normal(size=(n, 3)))).t))


@SECTION.case(
    "T3",
    "No ray from inside a sphere mesh far from the origin escapes at a vertex.",
    Tolerance("wrong", 0, None, "Embree's robust mode misses 1 in 1,000 rays that are aimed exactly at a vertex"),
    WATERTIGHT,
)
def far_vertices(subject: Subject) -> Iterator[Measurement]:
    center, n = np.array([51234.0, -777.0, 9123.0]), subject.count(100_000)
    if subject.accelerator == "none":
        n = 2000
    around, rng = sphere_mesh(24, center, 2.0), np.random.default_rng(3)
    origins = center + rng.uniform(-0.8, 0.8, (n, 3))  # not cast: on float32's coarse grid out there too few would escape
    targets = around.vertices[rng.integers(len(around.vertices), size=n)]
    yield measurement(np.isinf(subject.trace([around], origins, targets - origins).t))


@SECTION.case("T4", "No ray passes between triangles at shared vertices and edges.", NONE_WRONG, WATERTIGHT)
def shared_edges(subject: Subject) -> Iterator[Measurement]:
    around, n = sphere_mesh(12), subject.count(20_000)
    rng = np.random.default_rng(4)
    corners = around.vertices[around.faces[rng.integers(len(around.faces), size=n)]]
    along = rng.random((n, 1)) * (rng.random((n, 1)) < 0.5)  # half of them at vertices
    targets = corners[:, 0] * (1 - along) + corners[:, 1] * along
    origins = 0.5 * rng.random((n, 1)) * normalize(rng.normal(size=(n, 3)))
    for scale in (1.0, 1e-6, 1e6):
        scaled = mesh(subject.cast(around.vertices * scale), around.faces)
        start = subject.cast(origins * scale)
        hits = subject.trace([scaled], start, subject.cast(targets * scale) - start)
        yield measurement(np.isinf(hits.t), f"scale {scale:.0e}")


@SECTION.case("T5", "No ray passes the diagonal of a tilted quad, from any side.", NONE_WRONG)
def diagonal(subject: Subject) -> Iterator[Measurement]:
    corners, axis = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.ones(3) / np.sqrt(3.0)
    turned = subject.cast(np.cross(axis, corners) + np.outer(corners @ axis, axis))
    rng = np.random.default_rng(5)
    targets = turned[0] + rng.uniform(0.01, 0.99, (1024, 1)) * (turned[2] - turned[0])
    origins = subject.cast(5.0 * normalize(rng.normal(size=(1024, 3))))
    yield measurement(np.isinf(subject.trace([quad(turned)], origins, subject.cast(targets) - origins).t))


def _line(subject: Subject) -> Triangle:
    x, z = -1113.45459, -56.2431908
    return triangle(subject.cast([(x, y, z) for y in (-79.049614, -87.0922699, -79.2090149)]))


@SECTION.case("T6", "A triangle without area is not hit.", NONE_WRONG, "Embree's tests")
def no_area(subject: Subject) -> Iterator[Measurement]:
    origin = subject.cast([(-1081.47925, 99.9999542, 87.7701111)])
    direction = subject.cast([(-32.1072998, -183.355865, -144.607635)])
    renderer = subject.tracer(_line(subject))
    hit = np.isfinite(renderer.trace(origin, direction, 0.9999).t) | renderer.occluded(origin, direction, 0.9999)
    yield measurement(hit)


@SECTION.case(
    "T8",
    "A sliver is hit on its axis at any thickness; nothing is NaN.",
    Tolerance(
        "wrong",
        0,
        {"height 1e-02": 0, "height 1e-08": 0, "height 1e-16": 0},
        "float32 underflows below 1e-38, products of edges earlier",
    ),
)
def slivers(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(8), subject.count(2000)
    for height in (1e-2, 1e-8, 1e-16, 1e-30, 1e-44):
        sliver = Triangle((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), subject.cast_point((0.5, height, 0.0)), 0)
        renderer = subject.tracer(sliver)
        axis = renderer.trace([subject.cast_point((0.5, sliver.c[1] / 3, 1.0))], [(0.0, 0.0, -1.0)])
        origins = subject.cast(rng.uniform(-1, 1, (n, 3)))
        targets = np.stack([rng.random(n), height * rng.random(n), np.zeros(n)], -1)
        many = renderer.trace(origins, subject.cast(targets - origins))
        wrong = np.isnan(many.t) | np.isnan(many.normal).any(axis=1)
        yield measurement(np.append(wrong, axis.t[0] != 1.0), f"height {height:.0e}")


@SECTION.case("T10", "Faces without area are neither hit nor sampled as lights.", NONE_WRONG)
def degenerate_faces(subject: Subject) -> Iterator[Measurement]:
    point = triangle(np.zeros((3, 3)))
    good = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1], [0, 1, 2], [2, 0, 2]])
    hits = subject.trace([point, _line(subject), good], [(0.25, 0.25, 1.0)], [(0.0, 0.0, -1.0)])
    yield measurement((hits.shape[0], hits.primitive[0], hits.t[0]) != (2, 2, 1.0), "hit")
    emitter = square(1.0, 0.5, index=1, down=True)
    more = mesh(emitter.vertices, np.insert(emitter.faces, [0, 1, 2], [[0, 0, 1], [2, 2, 2], [3, 1, 3]], axis=0), 1)
    skins, view = [material(kd=0.5), material(emission=1)], point_view((1.0, 1.0, 2.0), (0.2, 0.0, 0.1), 8)
    seen, bare = (subject.image([FLOOR, light], skins, [], view, path_tracer(2), 4) for light in (more, emitter))
    yield measurement(seen != bare, "light sampling")


def _copies(count: int) -> Mesh:
    return mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([[0, 1, 2]], (count, 1)))


@SECTION.case("T11", "Of many copies of one triangle the lowest index is hit.", TIES)
def repeated(subject: Subject) -> Iterator[Measurement]:
    seconds, count, many = [], 1000, _copies(1000)
    for count in (1000,) if subject.accelerator == "none" or subject.quick else (1000, 4000, 100_000):
        if len(seconds) == 2 and (forecast := seconds[1] * max(seconds[1] / seconds[0], 1.0) ** 2.33) > 20:
            yield measurement(np.ones(1), f"{count} copies", note=f"the build would take {forecast:.0f} s")
            return
        many = _copies(count)
        seconds.append(float(subject.tracer(many).counters()["build_seconds"]))
    rng = np.random.default_rng(11)
    origins = np.concatenate([subject.cast(rng.uniform(0.05, 0.45, (20, 2))), np.ones((20, 1))], axis=1)
    hits = subject.trace([many], origins, np.tile([0.0, 0.0, -1.0], (20, 1)))
    yield measurement(np.isinf(hits.t) | (hits.primitive != 0), f"{count} copies")


@SECTION.case("T12", "Triangles that no split can separate are hit.", NONE_WRONG)
def unsplittable(subject: Subject) -> Iterator[Measurement]:
    a, b, c, d = (float(x) for x in subject.cast((-6.4000024, 25.6, 34.0, 57.6000022)))
    corners = [(b, d), (b, c), (a, d), (a, d)]
    shapes = [Triangle((x, 0.0, 0.0), (y, 0.0, 0.0), (y, 1.0, 0.0), 0) for x, y in corners]
    origins, expected = [(30.0, 0.05, 1.0), (0.0, 0.05, 1.0), (50.0, 0.05, 1.0)], [(0, 1, 2, 3), (2, 3), (0, 2, 3)]
    hits = subject.trace(shapes, subject.cast(origins), np.tile([0.0, 0.0, -1.0], (3, 1)))
    yield measurement([t != 1.0 or s not in nearest for t, s, nearest in zip(hits.t, hits.shape, expected, strict=True)])


@SECTION.case("T13", "Of two identical faces the shape with the lower index is hit.", TIES, "engines.interface")
def coplanar(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(13), subject.count(4000)
    tilted = subject.cast([[-1, -1, 0.1], [1, -1, 0.3], [1, 1, 0.2], [-1, 1, 0.0]])
    origins = subject.cast(rng.uniform(-1, 1, (n, 3)) + np.array([0, 0, 3]))
    directions = subject.cast(np.append(rng.uniform(-0.9, 0.9, (n, 2)), np.full((n, 1), 0.1), axis=1) - origins)
    hits = subject.trace([quad(tilted), quad(tilted)], origins, directions)
    yield measurement(hits.shape != 0)


@SECTION.case("T14", "Both sides of a triangle are hit, and the normal faces the ray.", NONE_WRONG, "engines.interface")
def both_sides(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(14), subject.count(800)
    origins = subject.cast(np.append(rng.uniform(-1, 1, (n, 2)), rng.choice([-1.0, 1.0], (n, 1)), axis=1))
    hits = subject.trace([UNIT_TRIANGLE], origins, subject.cast((0.3, 0.3, 0.0)) - origins)
    yield measurement((hits.shape != 0) | (hits.normal[:, 2] != np.sign(origins[:, 2])) | hits.normal[:, :2].any(axis=1))


@SECTION.case(
    "T15",
    "A cube has no holes at any scale.",
    Tolerance(
        "wrong",
        0,
        {"scale 1e-10": 0, "scale 1e+00": 0, "scale 1e+10": 0},
        "squares and products of coordinates leave float32's range",
    ),
)
def scales(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(15), subject.count(2000)
    inner, directions = rng.uniform(-0.9, 0.9, (n, 3)), subject.cast(rng.normal(size=(n, 3)))
    for scale in (1e-20, 1e-10, 1.0, 1e10, 1e18):
        size = float(subject.cast(scale))
        origins = subject.cast(inner * size)
        hits = subject.trace([box((-size,) * 3, (size,) * 3)], origins, directions)
        with np.errstate(invalid="ignore"):
            outside = np.abs(np.abs(origins + hits.t[:, None] * directions).max(axis=1) - size) > 64 * subject.eps * size
        yield measurement(outside | np.isinf(hits.t), f"scale {scale:.0e}")


@SECTION.case("T17", "t is exact on each step of a staircase.", Tolerance("eps", 4, 4))
def stairs(subject: Subject) -> Iterator[Measurement]:
    n = 64
    steps = [
        [(-1.0, k / n, k / n), (1.0, k / n, k / n), (1.0, (k + 1) / n, k / n), (-1.0, (k + 1) / n, k / n)] for k in range(n)
    ]
    faces = [face for k in range(0, 4 * n, 4) for face in ((k, k + 1, k + 2), (k, k + 2, k + 3))]
    y = subject.cast((np.arange(1000) + 0.5) / 1000)
    origins = np.stack([np.full(1000, 0.125), y, np.full(1000, 2.0)], -1)
    hits = subject.trace([mesh(np.array(steps).reshape(-1, 3), faces)], origins, np.tile([0.0, 0.0, -1.0], (1000, 1)))
    yield measurement(np.abs(hits.t - (2.0 - np.floor(y * n) / n)) / subject.eps)


def _thin_triangles(subject: Subject, n: int) -> tuple[Array, Array, Array]:
    """Corners (n, 3, 3) of triangles 1e-4 thin, and rays (origins, directions) that are almost in their planes."""
    rng = np.random.default_rng(18)
    a, along = rng.uniform(-1, 1, (n, 3)), normalize(rng.normal(size=(n, 3)))
    aside = normalize(np.cross(along, rng.normal(size=(n, 3))))
    out = np.cross(along, aside)
    corners = np.stack([a, a + along, a + 0.5 * along + 1e-4 * aside], 1)
    target = corners.mean(axis=1) + aside * rng.normal(size=(n, 1)) * 1e-4
    directions = normalize(aside + 1e-3 * rng.normal(size=(n, 1)) * out + 0.3 * rng.normal(size=(n, 1)) * along)
    origins = subject.cast(target - 3 * directions)
    return subject.cast(corners), origins, subject.cast(directions)


@SECTION.case(
    "T18",
    "Thin triangles that are almost parallel to the ray are not hit where the ray misses them.",
    Tolerance("wrong", 0, None, "a float32 test may report a hit on a thin triangle that the ray misses"),
)
def false_hits(subject: Subject) -> Iterator[Measurement]:
    n = subject.count(400)
    corners, origins, directions = _thin_triangles(subject, n)
    shapes = [triangle(corners[i]) for i in range(n)]
    traced = np.array([subject.trace([s], o[None], d[None]).t[0] for s, o, d in zip(shapes, origins, directions, strict=True)])
    exact = oracle.triangle(corners[:, 0], corners[:, 1], corners[:, 2], origins, directions)
    t, u, v = (np.asarray(part, np.float64) for part in exact)
    missed = (np.minimum(np.minimum(u, v), 1 - u - v) < -1e-9) | (t <= 0)
    yield measurement(
        np.isfinite(traced) & missed, f"{n} triangles", note=f"the exact answer is a miss for {int(missed.sum())}"
    )
