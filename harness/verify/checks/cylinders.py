"""Cylinders: hits against exact decimals, and the light of one that shines."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from engines.scene import Cylinder
from harness.trace import oracle
from harness.verify.case import Measurement, Section, measurement
from harness.verify.replicates import by_strategy
from harness.verify.scenes import FLOOR, ORIGIN, material, normalize, point_view
from harness.verify.subject import Subject
from harness.verify.tolerances import Tolerance, Z

SECTION = Section("cylinders")


@SECTION.case(
    "Y1",
    "Rays at cylinders hit the nearer crossing between their ends, from outside and from inside.",
    Tolerance("relative", 1e-11, 1e-4, "rays at the other side of a long cylinder cancel digits"),
)
def hits(subject: Subject) -> Iterator[Measurement]:
    rng = np.random.default_rng(3)
    count = subject.count(2000)
    for name, p0, p1, radius in (
        ("tilted", (0.25, -0.25, 0.5), (1.125, 1.375, -0.875), 0.5),
        ("long", (-8.0, 0.5, 0.25), (8.0, 0.75, -0.5), 0.125),
        ("flat", (0.0, 0.0, 0.0), (0.0, 0.0625, 0.03125), 1.5),
    ):
        centre, length = (np.array(p0) + p1) / 2, float(np.linalg.norm(np.subtract(p1, p0)))
        for where, spread in (("outside", 3 * (radius + length)), ("inside", 0.2 * min(radius, length))):
            origins = subject.cast(centre + spread * normalize(rng.normal(size=(count, 3))))
            aims = np.array(p0) + rng.random((count, 1)) * np.subtract(p1, p0) + radius * rng.normal(size=(count, 3))
            directions = subject.cast(aims - origins)
            exact, kept = oracle.cylinder(p0, p1, radius, origins, directions)
            t = subject.trace([Cylinder(p0, p1, radius, 0)], origins, directions).t
            yield measurement(oracle.relative(t[kept], exact[kept]), f"{name}, {where}")


@SECTION.case("Y2", "A cylinder light gives a floor the integral over the part of its surface that faces it.", Z)
def lights(subject: Subject) -> Iterator[Measurement]:
    places = (((-1.0, 1.0, 0.3), (0.8, 1.4, -0.2), 0.25), ((0.4, 0.6, -0.5), (0.9, 2.0, 0.4), 0.3))
    for number, (p0, p1, radius) in enumerate(subject.subset(places, 1)):
        truth = 0.5 / math.pi * irradiance(p0, p1, radius)
        shapes, materials = [FLOOR, Cylinder(p0, p1, radius, 1)], [material(kd=0.5), material(emission=1.0)]
        view = point_view((-4.0, 0.4, 1.0), ORIGIN, 32)
        yield from by_strategy(subject, shapes, materials, [], view, truth, "across" if number == 0 else "upright")


def irradiance(p0: tuple[float, ...], p1: tuple[float, ...], radius: float) -> float:
    """Of the origin, facing +y, from a cylinder of radiance 1 above it, by midpoints over its area."""
    start, way = np.array(p0), np.subtract(p1, p0)
    length = float(np.linalg.norm(way))
    axis = way / length
    side = np.cross(axis, (0.6, 0.0, 0.8))
    side /= np.linalg.norm(side)
    h, phi = ((np.arange(n) + 0.5) / n for n in (400, 2000))
    h, phi = h[:, None, None], 2 * math.pi * phi[:, None]
    normal = np.cos(phi) * side + np.sin(phi) * np.cross(axis, side)
    points = start + h * way + radius * normal
    distance = np.linalg.norm(points, axis=-1)
    cosines = np.maximum(points[..., 1] / distance, 0) * np.maximum(-(points * normal).sum(axis=-1) / distance, 0)
    return float((cosines / distance**2).mean() * 2 * math.pi * radius * length)
