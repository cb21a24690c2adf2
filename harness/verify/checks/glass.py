"""Mirrors and glass: the Fresnel equations, Snell's law, and scenes whose images are known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Decimal

import numpy as np

from engines.scene import EnvironmentLight, Perspective, Plane, Shape
from harness.verify.case import Measurement, Section, measurement
from harness.verify.scenes import (
    FLOOR,
    FRONT_CAMERA,
    ORIGIN,
    WHITE_SKY,
    box,
    glass,
    material,
    path_tracer,
    point_view,
    sphere,
    sphere_mesh,
    whitted,
)
from harness.verify.subject import Subject
from harness.verify.tolerances import EXACT, MANY_EVENTS, Tolerance

SECTION = Section("glass")
LONG = path_tracer(2000)
IORS = (1.5, 1.33, 2.4)
IMPACTS = (0.1, 0.5, 0.9)
TRAPPED = ((0.9, 1.5), (0.72, 1.5), (0.6, 2.4), (0.97, 1.1))
"""(impact, ior) of totally reflected rays. A reflected ray starts 256 eps deeper, so that k reflections make the impact b into
b exp(-256 eps k): 2000 of them make 0.72 into 0.677, and offsets that count the distance too take it below the critical
1 / 1.5; 0.97 stays above."""
GRAZING = {1.5: 1.16e-4, 1.33: 1.07e-4, 2.4: 7.5e-5}
"""What the offset adds to the error at impact 0.9 in float32, by ior: the ray inside starts d = 256 eps 5 m deeper, which moves
cos(i) at its exit by d sin^2(i) / cos(i), and 1 - R, met once, by |dR/dcos(i)| of that: to first order 1.16e-4, 1.07e-4 and
7.4e-5; below 1.1e-6 at 0.5."""


def fresnel(sine: float, eta: float, cosine: float | None = None) -> float:
    """Reflectance of unpolarised light, eta = n_t / n_i; the cosine is more exact for grazing rays."""
    c = Decimal(cosine) if cosine is not None else (1 - Decimal(sine) ** 2).sqrt()
    n, squared = Decimal(eta), Decimal(eta) ** 2 - 1 + c * c  # (n cos t)^2
    if squared <= 0:
        return 1.0
    s, p = (c - squared.sqrt()) / (c + squared.sqrt()), (n * n * c - squared.sqrt()) / (n * n * c + squared.sqrt())
    return float((s * s + p * p) / 2)


def toward(degrees: float, below: bool = False, distance: float = 4.0) -> Perspective:
    """A camera that sees the origin at an angle to the normal of the floor."""
    angle = math.radians(degrees)
    height = math.cos(angle) * distance * (-1 if below else 1)
    return point_view((math.sin(angle) * distance, height, 0.0), ORIGIN, up=(0.0, 0.0, 1.0))


def cosine_of(camera: Perspective) -> float:
    d = [t - e for t, e in zip(camera.target, camera.eye, strict=True)]
    return abs(d[1]) / math.hypot(*d)


def sine_of(camera: Perspective) -> float:
    """The sine of the angle between the camera's direction, as rounded, and the y axis."""
    d = [t - e for t, e in zip(camera.target, camera.eye, strict=True)]
    return math.hypot(d[0], d[2]) / math.hypot(*d)


@SECTION.case("D0", "The reflectance of an interface obeys the Fresnel equations, from both sides.", EXACT, "Fresnel 1823")
def reflectance(subject: Subject) -> Iterator[Measurement]:
    for ior in IORS:
        pane = material(ks=1, ior=ior, fresnel=True)
        for below, angles in ((False, (0, 30, 45, 60, 75, 80, 89)), (True, (0, 20, 24, 45, 60, 89))):
            errors = []
            for degrees in angles:
                view = toward(degrees, below)
                seen = subject.radiance([FLOOR], [pane], [WHITE_SKY], view, whitted(2))
                errors.append(seen - fresnel(0.0, 1 / ior if below else ior, cosine_of(view)))
            yield measurement(errors, f"ior {ior}, from {'inside' if below else 'outside'}")


@SECTION.case(
    "D1",
    "Glass of index 1 does not change the image.",
    Tolerance("absolute", 1e-9, 1e-3, "the sky changes by 1 per texel of 22 degrees"),
)
def index_one(subject: Subject) -> Iterator[Measurement]:
    rng = np.random.default_rng(1)
    sky = EnvironmentLight((1.0, 0.8, 0.6), rng.random((8, 16, 3)))
    held: list[tuple[str, list[Shape]]] = [
        ("sphere and box", [sphere(), box((-2, -2, -4), (2, 2, -2))]),
        ("mesh", [sphere_mesh(6, (0.4, 0.1, 0.0), 1.2)]),
        ("nested", [sphere((0, 0, 0), 1.5), sphere((0.3, 0.2, 0.0), 0.7)]),
    ]
    for name, shapes in subject.subset(held, 1):
        for shader in (whitted(), path_tracer(8)):
            seen, bare = (subject.image(these, [glass(1.0)], [sky], FRONT_CAMERA, shader, seed=3) for these in (shapes, []))
            yield measurement(seen - bare, f"{name}, {shader['name']}")


@SECTION.case(
    "D2",
    "A path of endless total internal reflection is black, and the render ends.",
    Tolerance(
        "absolute",
        0,
        {
            f"ior {ior}, impact {impact}, {shader}": 0
            for impact, ior in TRAPPED
            for shader in ("path_tracer", "whitted")
            if (impact, shader) != (0.72, "path_tracer")
        },
        "each of 2000 reflections starts 256 eps deeper in the glass, until the ray leaves it",
    ),
)
def trapped(subject: Subject) -> Iterator[Measurement]:
    for impact, ior in subject.subset(TRAPPED, 1):
        inside = Perspective((impact, 0.0, 0.0), (impact, 1.0, 0.0), (0.0, 0.0, 1.0), 10.0, "y", (4, 4))
        for shader in (LONG, whitted(32)):
            seen = subject.image([sphere()], [glass(ior)], [WHITE_SKY], inside, shader)
            yield measurement(seen, f"ior {ior}, impact {impact}, {shader['name']}")


@SECTION.case("D3", "Radiance inside glass is larger by the square of its index.", EXACT)
def inside_glass(subject: Subject) -> Iterator[Measurement]:
    for eye in subject.subset((ORIGIN, (0.3, 0.2, 0.1)), 1):  # within 1/n of the centre every ray gets out
        view = Perspective(eye, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 60.0, "y", (8, 8))
        for ior in IORS:
            seen = subject.image([sphere()], [glass(ior)], [WHITE_SKY], view, LONG)
            yield measurement(seen / ior**2 - 1, f"ior {ior}, eye {eye}")


@SECTION.case("b", "Lossless glass of any shape is invisible in a uniform environment.", MANY_EVENTS)
def vanishing(subject: Subject) -> Iterator[Measurement]:
    scenes: dict[str, list[Shape]] = {
        "sphere": [sphere()],
        "box": [box()],
        "mesh": [sphere_mesh(8)],
        "nested": [sphere((0, 0, 0), 1.5), sphere((0.3, 0.2, 0.0), 0.7)],
    }
    for name, shapes in scenes.items():
        for ior in subject.subset(IORS, 2):
            yield measurement(subject.image(shapes, [glass(ior)], [WHITE_SKY], FRONT_CAMERA, LONG, 4) - 1, f"{name}, ior {ior}")


@SECTION.case(
    "D5",
    "A ball lens deviates a ray by 2 (asin b - asin(b/n)) and transmits (1 - R)^2.",
    Tolerance(
        "absolute",
        1e-12,
        {f"ior {ior}, impact {b}": 1e-5 + (GRAZING[ior] if b == 0.9 else 0) for ior in IORS for b in IMPACTS},
        "rays start 256 eps off the surface, so a grazing ray leaves the glass elsewhere",
    ),
    "Snell",
)
def ball_lens(subject: Subject) -> Iterator[Measurement]:
    """A small light is where the ray must arrive: it is seen in full, or not at all."""
    for ior in IORS:
        for impact in IMPACTS:
            i, t = math.asin(impact), math.asin(impact / ior)
            bend, tolerance = 2 * (i - t), 1e-9 if subject.tracing == "float64" else 1e-3
            out = np.array([-math.cos(bend), -math.sin(bend)])
            start = np.array([math.sqrt(1 - impact**2), impact])
            inner = np.array([-math.cos(i - t), -math.sin(i - t)])
            exit_ = start + 2 * math.cos(t) * inner
            emitter = sphere((*(exit_ + 100 * out), 0.0), 100 * tolerance, 1)
            view = point_view((5.0, impact, 0.0), (0.0, impact, 0.0))
            seen = subject.radiance([sphere(), emitter], [glass(ior), material(emission=1)], [], view, whitted(3))
            yield measurement(seen - (1 - fresnel(impact, ior)) ** 2, f"ior {ior}, impact {impact}")


@SECTION.case("D6", "A grazing ray is refracted into the glass with the transmittance of the Fresnel equations.", EXACT)
def grazing(subject: Subject) -> Iterator[Measurement]:
    pane, bed = material(kt=1, ior=1.5, fresnel=True), Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), 1)
    errors = []
    for degrees in (*np.linspace(85, 89.9, 8), *(90 - 10.0 ** -np.arange(2, 10))):
        view = toward(float(degrees))
        seen = subject.radiance([FLOOR, bed], [pane, material(emission=1)], [], view, whitted(2))
        errors.append(seen - (1 - fresnel(0.0, 1.5, cosine_of(view))) / 2.25)
    yield measurement(errors)


@SECTION.case("D9", "Through the centre of a ball, whitted adds up the internal reflections that its depth allows.", EXACT)
def central(subject: Subject) -> Iterator[Measurement]:
    view = point_view((0.0, 0.0, 5.0), ORIGIN)
    for ior in IORS:
        r = ((ior - 1) / (ior + 1)) ** 2
        for events in range(3):
            truth = r + (1 - r) ** 2 * sum(r**k for k in range(events + 1))
            seen = subject.radiance([sphere()], [glass(ior)], [WHITE_SKY], view, whitted(3 + events))
            yield measurement(seen - truth, f"ior {ior}, {events} internal")


@SECTION.case("k", "Between two mirrors, radiance falls by the reflectance with each bounce.", EXACT)
def corridor(subject: Subject) -> Iterator[Measurement]:
    walls = [Plane((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0), Plane((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), 0)]
    for height, reflectance in subject.subset(((10.0, 0.9), (7.0, 0.8), (3.3, 0.3), (15.0, 1.0)), 2):
        end = Plane((0.0, 0.0, height), (0.0, 0.0, -1.0), 1)
        for degrees in (10, 30, 40, 60):
            angle = math.radians(degrees)
            view = point_view(ORIGIN, (math.sin(angle), 0.0, math.cos(angle)))
            truth = reflectance ** math.floor((height * math.tan(angle) + 1) / 2)
            for shader in (whitted(32), path_tracer(32)):
                seen = subject.radiance([*walls, end], [material(ks=reflectance), material(emission=1)], [], view, shader)
                yield measurement(seen - truth, f"{degrees} degrees, k {reflectance}, {shader['name']}")


@SECTION.case(
    "l", "A slab of glass shifts a ray by t sin(i) (1 - cos(i) / sqrt(n^2 - sin^2 i)) and transmits (1 - R)^2.", EXACT, "Snell"
)
def slab(subject: Subject) -> Iterator[Measurement]:
    """A small light is where the shifted ray must arrive; its depth excludes internal reflections."""
    for ior, thick in subject.subset([(ior, thick) for thick in (0.5, 0.02, 3.0) for ior in IORS], 3):
        surfaces = [Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0), Plane((0.0, -thick, 0.0), (0.0, -1.0, 0.0), 0)]
        for degrees in (0, 30, 60, 80):
            view = toward(degrees)
            sine = sine_of(view)
            cosine = math.sqrt(1 - sine * sine)
            shift = thick * sine * (1 - cosine / math.sqrt(ior**2 - sine * sine))
            along, aside = np.array([-sine, -cosine, 0.0]), np.array([cosine, -sine, 0.0])
            radius = 20 * (1e-9 if subject.tracing == "float64" else 1e-3)
            emitter = sphere(20 * along + shift * aside, radius, 1)
            seen = subject.radiance([*surfaces, emitter], [glass(ior), material(emission=1)], [], view, whitted(3))
            yield measurement(seen - (1 - fresnel(sine, ior)) ** 2, f"ior {ior}, t {thick}, {degrees} degrees")
