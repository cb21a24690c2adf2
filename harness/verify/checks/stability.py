"""Numerical stability: the error of t over distance, offset and radius; self-intersections and leaks over scale.

Each case varies one number over many decades, to be plotted (`report.plots.stability`). Unlike in other cases, inputs are
not rounded to the tracing precision first: rounding the float64 scene counts as an error of the engine. A parameter ends
with the number that is varied.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from engines.scene import Shape
from harness.trace import oracle
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.checks.spawned_rays import leaking, self_intersecting, view
from harness.verify.scenes import mesh, normalize, sphere, sphere_mesh, triangle
from harness.verify.subject import Subject
from harness.verify.tolerances import NONE_WRONG, Tolerance

SECTION = Section("stability")
CORNERS = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
DISTANCES, OFFSETS, RADII = range(0, 9), range(0, 9), range(-4, 7)
SCALES, GAPS = range(-6, 7, 2), (1e-3, 1e-5, 1e-7)
"""DISTANCES, OFFSETS, RADII and SCALES are exponents of ten; GAPS are relative to the scale."""


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
    return normalize(np.append(rng.uniform(-0.7, 0.7, (count, 2)), np.ones((count, 1)), axis=1))


def _errors(subject: Subject, shape: Shape, exact: oracle.Exact, origins: Array, towards: Array, name: str) -> Measurement:
    t = subject.trace([shape], origins, towards).t
    return measurement(oracle.relative(t, exact), name, oracle.ulps(t, exact, subject.dtype))


def _both(subject: Subject, center: Array, distance: float, parameter: str) -> Iterator[Measurement]:
    """A sphere and a triangle at `center`, seen from `distance`."""
    n = subject.count(400)
    disc, inside = _within(subject, n)
    origins = center + distance * _around(n)
    towards = normalize(center + disc - origins)
    exact = oracle.sphere_roots(center, 1.0, origins, towards)[0]
    yield _errors(subject, sphere(center), exact, origins, towards, f"sphere, {parameter}")
    corners, towards = center + CORNERS, normalize(center + inside - origins)
    exact = oracle.triangle(corners[0], corners[1], corners[2], origins, towards).t
    yield _errors(subject, triangle(corners), exact, origins, towards, f"triangle, {parameter}")


@SECTION.case(
    "t/distance",
    "t is exact from far away.",
    Tolerance(
        "relative",
        1e-14,
        {f"{shape}, distance 1e{power:+03d}": 1e-6 for shape in ("sphere", "triangle") for power in range(6)},
        "a rounded float32 direction is off by 6e-8 of the distance",
    ),
)
def over_distance(subject: Subject) -> Iterator[Measurement]:
    for power in DISTANCES:
        yield from _both(subject, np.zeros(3), 2.0 + 10.0**power, f"distance 1e{power:+03d}")


@SECTION.case("t/offset", "t is exact far from the origin.", Tolerance("relative", 1e-14, 1e-6))
def over_offset(subject: Subject) -> Iterator[Measurement]:
    for power in OFFSETS:
        yield from _both(subject, 10.0**power * np.array([1.0, -0.7, 0.3]), 5.0, f"offset 1e{power:+03d}")


@SECTION.case(
    "t/radius",
    "t of a sphere is exact at any radius.",
    Tolerance(
        "relative",
        {f"sphere, radius 1e{power:+03d}": max(1e-14, 1e-15 * 10.0**power) for power in RADII},
        1e-6,
        "b2 - 4ac grows with the square of the radius",
    ),
)
def over_radius(subject: Subject) -> Iterator[Measurement]:
    n = subject.count(400)
    disc = _within(subject, n)[0]
    for power in RADII:
        radius = 10.0**power
        center, aside = np.array([0.0, -radius, 0.0]), min(radius, 1.0) * disc[:, :2]
        height = np.sqrt(radius**2 - (aside**2).sum(axis=1))
        origins = np.tile([0.0, 1.5, 0.0], (n, 1))
        towards = normalize(np.stack([aside[:, 0], height - radius, aside[:, 1]], -1) - origins)
        exact = oracle.sphere_roots(center, radius, origins, towards)[0]
        yield _errors(subject, sphere(center, radius), exact, origins, towards, f"sphere, radius 1e{power:+03d}")


@SECTION.case("self/scale", "Rays that leave a body do not hit it again, at any scale.", NONE_WRONG)
def self_hits(subject: Subject) -> Iterator[Measurement]:
    side, round_mesh = 32 if subject.quick else 96, sphere_mesh(10)
    for power in SCALES:
        scale = 10.0**power
        bodies = {"sphere": sphere(radius=scale), "mesh": mesh(scale * round_mesh.vertices, round_mesh.faces)}
        for name, body in bodies.items():
            camera = view(scale * np.array([3.0, 2.0, 4.0]), np.zeros(3), 25.0, side)
            wrong = [self_intersecting(subject, [body], camera, direct) for direct in ("light", "bsdf")]
            yield measurement(np.concatenate(wrong), f"{name}, scale 1e{power:+03d}")


@SECTION.case(
    "leak/scale",
    "No light leaks into the gap between two plates, at any scale.",
    Tolerance(
        "wrong",
        0,
        {f"gap 1e-03, scale 1e{power:+03d}": 0 for power in SCALES},
        "in float32 rays are offset by 3e-5 of the largest coordinate",
    ),
)
def leaks(subject: Subject) -> Iterator[Measurement]:
    for gap in GAPS:
        for power in SCALES:
            seen = leaking(subject, 10.0**power, gap, 16)
            yield measurement(seen, f"gap {gap:.0e}, scale 1e{power:+03d}")
