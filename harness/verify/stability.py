"""Where digits go as numbers grow: error of t over distance, offset and radius; self-hits and leaks over scale.

These cases sweep one number over many decades, so that they can be drawn (`harness.report.plots.stability`). Unlike the others
they are not rounded to the tracing precision first: an engine is given a float64 scene, and what it makes of it is its
own doing. A parameter ends with the number that is varied.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from engines.scene import Shape
from harness.verify import oracle
from harness.verify.case import Array, Measured, Section, measured
from harness.verify.spawned_rays import leaking, met_again, view
from harness.verify.stage import ball, mesh, sphere, triangle, unit
from harness.verify.subject import Subject

SECTION = Section("stability")
CORNERS = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
DISTANCES, OFFSETS, RADII = range(0, 9), range(0, 9), range(-4, 7)
SCALES, GAPS = range(-6, 7, 2), (1e-3, 1e-5, 1e-7)
"""Powers of ten; gaps are shares of the scale."""


def _within(subject: Subject, count: int) -> tuple[Array, Array]:
    """Points (n, 3) of the unit sphere's disc across z, and of the triangle `CORNERS`, away from their rims."""
    rng = np.random.default_rng(21)
    impact, angle = 0.9 * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    disc = np.stack([impact * np.cos(angle), impact * np.sin(angle), np.zeros(count)], -1)
    weights = 0.94 * rng.dirichlet(np.ones(3), count) + 0.02
    return disc, weights @ CORNERS


def _around(count: int) -> Array:
    """Directions (n, 3) within 45 degrees of z."""
    rng = np.random.default_rng(22)
    return unit(np.append(rng.uniform(-0.7, 0.7, (count, 2)), np.ones((count, 1)), axis=1))


def _errors(subject: Subject, shape: Shape, exact: oracle.Exact, origins: Array, towards: Array, name: str) -> Measured:
    found = subject.trace([shape], origins, towards).t
    return measured(oracle.relative(found, exact), name, oracle.ulps(found, exact, subject.kind))


def _both(subject: Subject, center: Array, distance: float, words: str) -> Iterator[Measured]:
    """A sphere and a triangle at `center`, seen from `distance`."""
    n = subject.count(400)
    disc, inside = _within(subject, n)
    origins = center + distance * _around(n)
    towards = unit(center + disc - origins)
    exact = oracle.sphere_roots(center, 1.0, origins, towards)[0]
    yield _errors(subject, sphere(center), exact, origins, towards, f"sphere, {words}")
    corners, towards = center + CORNERS, unit(center + inside - origins)
    exact = oracle.triangle(corners[0], corners[1], corners[2], origins, towards).t
    yield _errors(subject, triangle(corners), exact, origins, towards, f"triangle, {words}")


@SECTION.case("t/distance", "What is far away is hit where it is.", "raybench, HARNESS")
def over_distance(subject: Subject) -> Iterator[Measured]:
    for power in DISTANCES:
        yield from _both(subject, np.zeros(3), 2.0 + 10.0**power, f"distance 1e{power:+03d}")


@SECTION.case("t/offset", "A scene far from the origin is hit where it is.", "raybench, HARNESS")
def over_offset(subject: Subject) -> Iterator[Measured]:
    for power in OFFSETS:
        yield from _both(subject, 10.0**power * np.array([1.0, -0.7, 0.3]), 5.0, f"offset 1e{power:+03d}")


@SECTION.case("t/radius", "A sphere is hit where it is, be it a grain or the ground.", "raybench, HARNESS")
def over_radius(subject: Subject) -> Iterator[Measured]:
    n = subject.count(400)
    disc = _within(subject, n)[0]
    for power in RADII:
        radius = 10.0**power
        center, aside = np.array([0.0, -radius, 0.0]), min(radius, 1.0) * disc[:, :2]
        height = np.sqrt(radius**2 - (aside**2).sum(axis=1))
        origins = np.tile([0.0, 1.5, 0.0], (n, 1))
        towards = unit(np.stack([aside[:, 0], height - radius, aside[:, 1]], -1) - origins)
        exact = oracle.sphere_roots(center, radius, origins, towards)[0]
        yield _errors(subject, sphere(center, radius), exact, origins, towards, f"sphere, radius 1e{power:+03d}")


@SECTION.case("self/scale", "Rays that leave a body do not meet it again, whatever its scale.", "raybench, HARNESS")
def self_hits(subject: Subject) -> Iterator[Measured]:
    side, round_mesh = 32 if subject.quick else 96, ball(10)
    for power in SCALES:
        scale = 10.0**power
        bodies = {"sphere": sphere(radius=scale), "mesh": mesh(scale * round_mesh.vertices, round_mesh.faces)}
        for name, body in bodies.items():
            camera = view(scale * np.array([3.0, 2.0, 4.0]), np.zeros(3), 25.0, side)
            wrong = [met_again(subject, [body], camera, direct) for direct in ("light", "bsdf")]
            yield measured(np.concatenate(wrong), f"{name}, scale 1e{power:+03d}")


@SECTION.case("leak/scale", "No light gets into the gap between two plates, whatever its scale.", "raybench, HARNESS")
def leaks(subject: Subject) -> Iterator[Measured]:
    for gap in GAPS:
        for power in SCALES:
            seen = leaking(subject, 10.0**power, gap, 16)
            yield measured(seen, f"gap {gap:.0e}, scale 1e{power:+03d}")
