"""What a surface does with light: it loses none of it where it should not, makes none, and answers alike both ways."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engines.scene import DirectionalLight, Material, Plane, Shape
from harness.verify.case import Measured, Section, measured
from harness.verify.glass import cosine_of, fresnel, toward
from harness.verify.replicates import STRATEGIES, means, z_score
from harness.verify.stage import FLOOR, ORIGIN, SKY, grey, material, path_tracer, point_view, sphere, whitted
from harness.verify.subject import Subject

SECTION = Section("materials")
MIDDLE: dict[str, Any] = {"sampler": "constant"}
LOSSLESS: dict[str, Material] = {
    "matte": material(kd=1),
    "mirror": material(ks=1),
    "half a mirror": material(kd=0.5, ks=0.5),
    "mostly mirror": material(kd=0.25, ks=0.75),
    "glass": material(ks=1, kt=1, ior=1.5, fresnel=True),
    "glass without Fresnel": material(ks=0.3, kt=0.7, ior=1.5),
    "clear": material(kt=1, ior=1.33),
    "frosted": material(kd=0.2, ks=0.3, kt=0.5, ior=1.3),
    "coated": material(kd=0.4, ks=0.6, kt=0.6, ior=1.5, fresnel=True),
    "coloured": Material("m", (0.2, 0.25, 0.3), (0.3, 0.35, 0.3), (0.5, 0.4, 0.4), 1.4),
}
ABSORBING: dict[str, Material] = {
    "matte": material(kd=0.7),
    "mirror": material(ks=0.9),
    "mixed": material(kd=0.3, ks=0.4),
    "pane": material(ks=0.2, kt=0.5, ior=1.5),
    "glass": material(ks=1, kt=1, ior=1.5, fresnel=True),
    "diamond": material(ks=0.9, kt=0.95, ior=2.4, fresnel=True),
    "frosted": material(kd=0.2, ks=0.5, kt=0.6, ior=1.3, fresnel=True),
}
ANGLES = (0, 20, 45, 70, 85)


@SECTION.case("wf", "In a white sky every lossless opaque material is white: white furnace.", "raybench, b and c")
def white(subject: Subject) -> Iterator[Measured]:
    """A path that scatters by the surface alone is worth exactly 1; where light is sampled apart, only whole lobes are."""
    view = point_view((0.5, 3.0, 2.0), ORIGIN, 8)
    for name in ("matte", "mirror", "half a mirror", "mostly mirror"):
        for direct in STRATEGIES if name in ("matte", "mirror") else ("bsdf",):
            seen = subject.image([sphere()], [LOSSLESS[name]], [SKY], view, path_tracer(9, direct))
            yield measured(seen - 1, f"{name}, {direct}")


@SECTION.case("wf.glass", "In a white sky every lossless transparent body vanishes.", "raybench, b")
def white_glass(subject: Subject) -> Iterator[Measured]:
    view = point_view((0.5, 3.0, 2.0), (0.5, 0.3, 0.2), 8)
    for name in ("glass", "glass without Fresnel", "clear", "frosted", "coated"):
        seen = subject.image([sphere()], [LOSSLESS[name]], [SKY], view, path_tracer(2000, "bsdf"))
        yield measured(seen - 1, name)


@SECTION.case("wf.z", "So is every mixture, by every strategy, on average.", "raybench, b and c")
def white_mixtures(subject: Subject) -> Iterator[Measured]:
    view = point_view((0.5, 3.0, 2.0), (0.5, 0.3, 0.2), 32)
    for name in subject.some(("half a mirror", "mostly mirror", "frosted", "coated", "coloured"), 1):
        for direct in STRATEGIES if name == "coloured" else ("light", "mis"):
            seen = means(subject, [sphere()], [LOSSLESS[name]], [SKY], view, path_tracer(100, direct), 2)
            yield z_score(subject, seen, 1.0, f"{name}, {direct}")


@SECTION.case("energy", "A surface reflects and transmits what its weights say, and never more than it receives.",
              "Veach 1997, 4.5 and 5.3")  # fmt: skip
def energy(subject: Subject) -> Iterator[Measured]:
    """Seen under a white sky with a black bed behind (R), then without it: the rest is T / eta^2 of the sky there."""
    for name, given in ABSORBING.items():
        for below in (False, True):
            eta = 1 / given.ior if below else given.ior
            bed = Plane((0.0, 1.0 if below else -1.0, 0.0), (0.0, 1.0, 0.0), 1)
            errors = []
            for degrees in ANGLES:
                view = toward(degrees, below)
                sides: list[list[Shape]] = [[FLOOR, bed], [FLOOR]]
                black, both = (
                    subject.image(held, [given, material()], [SKY], view, whitted(2), **MIDDLE)[0, 0] for held in sides
                )
                reflected, transmitted = _weights(given, eta, cosine_of(view))
                sent = black + (both - black) * eta**2
                errors += [black - reflected, (both - black) * eta**2 - transmitted, max(sent - 1, 0.0)]
            yield measured(errors, f"{name}, from {'behind' if below else 'the front'}")


def _weights(given: Material, eta: float, cosine: float) -> tuple[float, float]:
    """(reflected, transmitted) shares of the light; total reflection without Fresnel keeps the weight of kt."""
    kd, ks, kt = given.kd[0], given.ks[0], given.kt[0]
    if given.fresnel:
        share = fresnel(0.0, eta, cosine)
        return kd + ks * share, kt * (1 - share)
    total = (1 - cosine**2) / eta**2 >= 1
    return (kd + ks + kt, 0.0) if total else (kd + ks, kt)


@SECTION.case("recip", "Light and eye change places: f(wi, wo) = f(wo, wi).", "Veach 1997, 5.2")
def reciprocity(subject: Subject) -> Iterator[Measured]:
    """A directional light seen by a camera, then from where the light came with the light where the camera was."""
    directions = [_direction(*angles) for angles in ((0, 0), (30, 10), (60, 200), (80, 100))]
    for name in ("matte", "mixed", "frosted"):
        errors = []
        for a, b in ((a, b) for a in directions for b in directions if a is not b):
            there, back = (_scattered(subject, ABSORBING[name], i, o) for i, o in ((a, b), (b, a)))
            errors += [there - back, there - ABSORBING[name].kd[0] / math.pi]
        yield measured(errors, name)


def _direction(polar: float, azimuth: float) -> np.ndarray:
    theta, phi = math.radians(polar), math.radians(azimuth)
    return np.array([math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi)])


def _scattered(subject: Subject, given: Material, light: np.ndarray, eye: np.ndarray) -> float:
    x, y, z = (float(value) for value in -light)
    view = point_view(4 * eye, ORIGIN, up=(0.3, 0.2, 0.9))
    sun = DirectionalLight((x, y, z), grey(1))
    return float(subject.image([FLOOR], [given], [sun], view, path_tracer(2), **MIDDLE)[0, 0]) / -y


@SECTION.case(
    "recip.glass", "Two media see each other alike: L / n^2 is the same in both directions (Stokes).", "Stokes 1849"
)
def stokes(subject: Subject) -> Iterator[Measured]:
    """At angles that belong together by Snell's law, a lamp below seen from above, and one above seen from below."""
    for name in ("glass", "diamond", "pane"):
        given = ABSORBING[name]
        errors = []
        # not closer to 90: there n^2 tan magnifies the rounding of the inner ray in float32 beyond what is allowed
        for degrees in (0, 15, 40, 65, 85):
            inner = math.degrees(math.asin(math.sin(math.radians(degrees)) / given.ior))
            seen = []
            for angle, below in ((degrees, False), (inner, True)):
                lamp = Plane((0.0, 1.0 if below else -1.0, 0.0), (0.0, -1.0 if below else 1.0, 0.0), 1)
                view = toward(angle, below, distance=0.5)
                seen.append(
                    subject.image([FLOOR, lamp], [given, material(emission=1)], [], view, whitted(2), **MIDDLE)[0, 0]
                )
            errors.append(seen[0] * given.ior**2 - seen[1] / given.ior**2)
        yield measured(errors, name)
