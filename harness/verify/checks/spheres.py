"""Spheres: near, far, huge, from inside, tangent, far from the origin, overlapping."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.trace import oracle
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.scenes import normalize, sphere
from harness.verify.subject import Subject
from harness.verify.tolerances import NONE_WRONG, Tolerance

SECTION = Section("spheres", each_accelerator=True)
SOURCE = "Haines, Günther and Akenine-Möller 2019 (Ray Tracing Gems, 7)"
LAST_DIGITS = Tolerance("relative", 4e-15, 1e-6)


def _against(
    subject: Subject, center: Array, radius: float, origins: Array, directions: Array, parameter: str, far: bool = False
) -> Measurement:
    """Relative errors of t, compared with the nearer root or (`far`) the farther one."""
    hits = subject.trace([sphere(center, radius)], origins, directions)
    exact = oracle.sphere_roots(center, radius, origins, directions)[int(far)]
    return measurement(oracle.relative(hits.t, exact), parameter, oracle.ulps(hits.t, exact, subject.dtype))


@SECTION.case("S1", "t of a unit sphere is exact to the last digits from any distance.", LAST_DIGITS, SOURCE)
def distant(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(3), subject.count(400)
    for power in range(2, 8):
        impact, angle = 0.95 * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
        start = np.stack([impact * np.cos(angle), impact * np.sin(angle), np.full(n, 10.0**power)], -1)
        ahead = np.tile([0.0, 0.0, -1.0], (n, 1))
        yield _against(subject, np.zeros(3), 1.0, subject.cast(start), ahead, f"from 1e{power}")


@SECTION.case(
    "S3",
    "t of a sphere that is as large as a floor is exact.",
    Tolerance(
        "relative",
        {"R = 1e3": 1e-12, "R = 1e4": 1e-11, "R = 1e5": 1e-10, "R = 1e6": 1e-9},
        1e-6,
        "every engine solves spheres in float64; float32 formulas are 3 to 7 % wrong at 1e6",
    ),
)
def huge(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(4), subject.count(400)
    turn = 2 * np.pi * rng.random(n)
    directions = subject.cast(np.stack([np.cos(turn), np.full(n, -0.5), np.sin(turn)], -1))
    for power in range(3, 7):
        center = np.array([0.0, -(10.0**power), 0.0])
        yield _against(subject, center, 10.0**power, np.tile([0.0, 1.5, 0.0], (n, 1)), directions, f"R = 1e{power}")


@SECTION.case("S11", "Just above a large sphere, the near root loses no digits.", LAST_DIGITS, SOURCE)
def above(subject: Subject) -> Iterator[Measurement]:
    """Radius and height are powers of two straight above the centre, so that only the roots round."""
    rng, n = np.random.default_rng(11), subject.count(400)
    turn = 2 * np.pi * rng.random(n)
    directions = subject.cast(np.stack([0.3 * np.cos(turn), -1 - rng.random(n), 0.3 * np.sin(turn)], -1))
    for power in (10, 20):
        radius = 2.0**power
        origins = np.tile([0.0, radius + 2.0**-3, 0.0], (n, 1))
        yield _against(subject, np.zeros(3), radius, origins, directions, f"R = 2^{power}")


@SECTION.case("S4", "Rays from inside hit the far side.", Tolerance("relative", 1e-13, 1e-6))
def inside(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(4), subject.count(400)
    origins = subject.cast(0.9 * rng.random((n, 1)) * normalize(rng.normal(size=(n, 3))))
    directions = subject.cast(rng.normal(size=(n, 3)))
    yield _against(subject, np.zeros(3), 1.0, origins, directions, "", far=True)


@SECTION.case("S5", "Rays from the surface inwards hit the far side; rays outwards miss.", Tolerance("eps/cos", 8, 8))
def from_the_surface(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(5), subject.count(800)
    origins, directions = (subject.cast(normalize(rng.normal(size=(n, 3)))), subject.cast(normalize(rng.normal(size=(n, 3)))))
    cosines = (origins * directions).sum(axis=1)
    directions = np.where(cosines[:, None] > 0, -directions, directions)
    kept = np.abs(cosines) > 1e-2
    origins, directions, cosines = origins[kept], directions[kept], cosines[kept]
    renderer = subject.tracer(sphere())
    hits = renderer.trace(origins, directions)
    near, far = oracle.sphere_roots(np.zeros(3), 1.0, origins, directions)
    touched, left = np.zeros(len(origins), bool), np.isfinite(renderer.trace(origins, -directions).t)
    if subject.tracing != "float64":  # the origin lies clearly outside or inside: then the root near it is one too
        touched, left = (near > 0) & (hits.t < 1e-3), np.zeros(len(origins), bool)
    exact = np.where(touched, near, far)
    errors = oracle.absolute(hits.t, exact) * np.abs(cosines) / subject.eps
    yield measurement(np.where(left, np.inf, errors), "", oracle.ulps(hits.t, far, subject.dtype)[~touched])


@SECTION.case("S6", "A tangent ray hits at the right distance or misses; nothing is NaN.", NONE_WRONG)
def tangent(subject: Subject) -> Iterator[Measurement]:
    heights = [1.0, *(float(np.nextafter(subject.dtype(1), subject.dtype(side))) for side in (0, 2))]
    for distance in (3.0, 1e3, 1e6):
        origins = np.array([(0.0, height, distance) for height in heights])
        hits = subject.trace([sphere()], origins, np.tile([0.0, 0.0, -1.0], (3, 1)))
        close = np.abs(hits.t - distance) <= max(2 * np.sqrt(subject.eps), 4 * subject.eps * distance)
        yield measurement(~(np.isinf(hits.t) | close) | np.isnan(hits.normal).any(axis=1), f"from {distance:.0e}")


@SECTION.case("S7", "The hit point does not depend on the length of the direction.", LAST_DIGITS)
def scaled(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(7), subject.count(200)
    origins = subject.cast(4 * normalize(rng.normal(size=(n, 3))))
    toward = 0.9 * normalize(rng.normal(size=(n, 3))) * rng.random((n, 1)) - origins
    for power in (-10, -3, 3, 10):
        directions = subject.cast(toward * 10.0**power)
        yield _against(subject, np.zeros(3), 1.0, origins, directions, f"length 1e{power}")


@SECTION.case("S8", "t is as exact a million metres from the origin.", LAST_DIGITS)
def far_scene(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(8), subject.count(400)
    origins = subject.cast(1e6 + 5 * normalize(rng.normal(size=(n, 3))))
    directions = subject.cast(1e6 + 0.5 * rng.uniform(-1, 1, (n, 3)) - origins)
    yield _against(subject, np.full(3, 1e6), 1.0, origins, directions, "")


@SECTION.case(
    "S10",
    "Of two overlapping spheres, a ray that is almost tangent hits the nearer one.",
    Tolerance("absolute", 1e-4, 1e-4),
    "Embree issue 676",
)
def overlapping(subject: Subject) -> Iterator[Measurement]:
    spheres = [
        sphere(subject.cast(center), 9.0)
        for center in ((9.66870880, -16.3965702, 3.93995930), (10.0441875, -9.69345284, 3.94893074))
    ]
    hits = subject.trace(
        spheres,
        subject.cast([(14.8001127, -9.01768494, 3.47012758)]),
        subject.cast([(-0.989340246, -0.0190101117, -0.144376263)]),
    )
    yield measurement(np.where(hits.shape == 0, np.abs(hits.t - 10.2983), np.inf))
