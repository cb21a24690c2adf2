"""Rendered images whose radiance is known: each lettered truth as a scene with its closed form beside it.

Estimators without variance are held to rounding; the others by z over the 1,024 pixels of a view so narrow that they
are replicates of one point, or over 32 images with seeds of their own, for `direct: light`, `bsdf` and `mis` alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engines.scene import DirectionalLight, EnvironmentLight, Light, Material, Orthographic, Plane, PointLight, Shape
from harness.verify import closed_forms as forms
from harness.verify.case import Array, Measured, Section, measured
from harness.verify.stage import (
    FLOOR,
    ORIGIN,
    SKY,
    ball,
    box,
    grey,
    material,
    mesh,
    path_tracer,
    point_view,
    sphere,
    square,
    whitted,
)  # fmt: skip
from harness.verify.subject import Subject

SECTION = Section("light")
STRATEGIES = ("light", "bsdf", "mis")
LARGEST_ERROR = 2e-3
MIDDLE: dict[str, Any] = {"sampler": "constant"}
WARM = material(kd=0.5, emission=0.5, two_sided=True)
CORNER = {"eye": (0.2, 0.1, 0.3), "target": (0.9, -0.2, 0.1)}


def _z(subject: Subject, replicates: Array, truth: float, parameter: str, largest: float = LARGEST_ERROR) -> Measured:
    """In standard errors; infinite where the standard error is too large to tell anything."""
    values = np.asarray(replicates).ravel()
    rounding = (1e-12 if subject.tracing == "float64" else 2e-6) * abs(truth)
    error = max(float(values.std(ddof=1)) / math.sqrt(values.size), rounding)
    z = (values.mean() - truth) / error if error < largest else math.inf
    return measured(z, parameter, note=f"{values.mean():.6f} against {truth:.6f}, standard error {error:.1e}")


def _point(subject: Subject, shapes: Sequence[Shape], materials: Sequence[Material], lights: Sequence[Light], view: Any,
           shader: Any, spp: int) -> Array:  # fmt: skip
    """1,024 replicates of one pixel."""
    return subject.image(shapes, materials, lights, view, shader, spp, seed=5)


def _floor_view(x: float = 0.0, z: float = 0.0, side: int = 32) -> Any:
    return point_view((x + 0.3, 1.5, z + 4.0), (x, 0.0, z), side)


@SECTION.case("a", "A closed furnace is E (1 - rho^D) / (1 - rho) bright, whatever its shape.", "raybench, a")
def furnace(subject: Subject) -> Iterator[Measured]:
    for name, hollow in (("box", box()), ("mesh", ball(8)), ("sphere", sphere())):
        for emission, rho, depth in ((0.5, 0.5, 1), (0.5, 0.5, 2), (0.5, 0.5, 5), (2.0, 0.8, 3), (0.3, 0.9, 20)):
            walls = material(kd=rho, emission=emission, two_sided=True)
            truth = emission * (1 - rho**depth) / (1 - rho)
            seen = subject.image([hollow], [walls], [], point_view(**CORNER, side=4), path_tracer(depth, "bsdf"))
            yield measured(seen / truth - 1, f"{name}, E {emission}, rho {rho}, D {depth}")


@SECTION.case("a.mis", "The furnace is as bright where lights are sampled too.", "raybench, a")
def furnace_mis(subject: Subject) -> Iterator[Measured]:
    for name, hollow in (("box", box()), ("sphere", sphere())):
        for depth in (2, 3):
            view = point_view(**CORNER, side=32)
            seen = _point(subject, [hollow], [WARM], [], view, path_tracer(depth, "mis"), 32)
            yield _z(subject, seen, 1 - 0.5**depth, f"{name}, D {depth}")


@SECTION.case("rr", "Russian roulette leaves the mean as it is.", "raybench")
def roulette_mean(subject: Subject) -> Iterator[Measured]:
    for rr_depth in (1, 2, 4):
        shader = path_tracer(10_000, "bsdf", rr_depth)
        seen = _point(subject, [box()], [WARM], [], point_view(**CORNER, side=64), shader, 48)
        yield _z(subject, seen, 1.0, f"from segment {rr_depth}")


@SECTION.case("rr2", "Russian roulette has the second moment that follows from its survival.", "raybench")
def roulette_square(subject: Subject) -> Iterator[Measured]:
    """From the first segment on, survival is min(beta, 0.95) and the survivor's beta is max(beta, beta / 0.95)."""
    for rho in (0.5, 0.7):
        walls = material(kd=rho, emission=1 - rho, two_sided=True)
        shader = path_tracer(10_000, "bsdf", 1)
        seen = _point(subject, [box()], [walls], [], point_view(**CORNER, side=256), shader, 1)
        yield _z(subject, seen**2, forms.roulette_second_moment(1 - rho, rho), f"rho {rho}", 2e-2)


@SECTION.case("c", "Under a uniform sky a convex body is as bright as its albedo.", "raybench, c")
def convex(subject: Subject) -> Iterator[Measured]:
    view = point_view((0.5, 3.0, 2.0), ORIGIN, 8)
    for rho in (0.3, 0.7, 1.0):
        for direct in STRATEGIES:
            seen = [subject.image([body], [material(kd=rho)], [SKY], view, path_tracer(2, direct))
                    for body in (sphere(), box(), ball(8))]  # fmt: skip
            yield measured(np.concatenate(seen).ravel() - rho, f"rho {rho}, {direct}")


@SECTION.case("wf", "In a white sky every lossless material is white: white furnace.", "raybench, b and c")
def white(subject: Subject) -> Iterator[Measured]:
    """Diffuse and mirror lobes, alone and mixed, on a convex body; energy is neither lost nor made."""
    view = point_view((0.5, 3.0, 2.0), ORIGIN, 8)
    for kd, ks in ((1, 0), (0, 1), (0.5, 0.5), (0.25, 0.75)):
        for direct in STRATEGIES:
            # the lobe weights of a path are whole: its value is 1 only where light is not sampled apart
            if direct == "bsdf" or kd * ks == 0:
                seen = subject.image([sphere()], [material(kd=kd, ks=ks)], [SKY], view, path_tracer(9, direct))
                yield measured(seen - 1, f"kd {kd}, ks {ks}, {direct}")


@SECTION.case("c.sky", "A sky a + b cos gives a floor rho (a + 2 b / 3).", "raybench, c")
def graded(subject: Subject) -> Iterator[Measured]:
    cosine = np.maximum(np.cos(np.pi * (np.arange(512) + 0.5) / 512), 0.0)
    for a, b, rho in ((0.2, 0.6, 0.8), (0.0, 1.0, 0.5)):
        sky = EnvironmentLight((1.0, 1.0, 1.0), np.repeat(a + b * cosine, 3 * 8).reshape(512, 8, 3))
        for direct in STRATEGIES:
            spp = 64 if direct == "light" else 16
            seen = _point(subject, [FLOOR], [material(kd=rho)], [sky], _floor_view(), path_tracer(2, direct), spp)
            yield _z(subject, seen, rho * (a + 2 * b / 3), f"a {a}, b {b}, {direct}")


@SECTION.case("d", "A point light at the centre of a sphere: 1 - rho^k after k reflections.", "raybench, d")
def centred(subject: Subject) -> Iterator[Measured]:
    view = point_view((0.3, 0.0, 0.1), (0.5, 0.7, 0.2), 4)
    for rho in (0.5, 0.8):
        light = PointLight(ORIGIN, grey(math.pi * (1 - rho) / rho))
        for k in (1, 2, 5, 12):
            seen = subject.image([sphere()], [material(kd=rho)], [light], view, path_tracer(k + 1))
            yield measured(seen - (1 - rho**k), f"rho {rho}, k {k}")


@SECTION.case("d.off", "Off its centre: rho/pi (I cos/d^2 + rho/(1 - rho) I/r^2).", "raybench, d")
def off_centre(subject: Subject) -> Iterator[Measured]:
    point = np.array([0.3, 0.0, -math.sqrt(1 - 0.09)])
    for y, rho in ((0.5, 0.5), (-0.3, 0.3)):
        to_light = np.array([0.0, y, 0.0]) - point
        distance = float(np.linalg.norm(to_light))
        truth = rho / math.pi * (float(to_light @ -point) / distance**3 + rho / (1 - rho))
        view = point_view((0.3, 0.0, 0.1), (0.3, 0.0, -1.0), 32)
        light = PointLight((0.0, y, 0.0), (1.0, 1.0, 1.0))
        yield _z(
            subject, _point(subject, [sphere()], [material(kd=rho)], [light], view, path_tracer(30), 8), truth, f"y {y}"
        )


@SECTION.case("e", "A polygon light obeys Lambert's formula, clipped at the horizon too.", "Lambert 1760")
def polygons(subject: Subject) -> Iterator[Measured]:
    materials = [material(kd=0.7), material(emission=1.0)]
    wall = np.array([(2.0, -0.5, -0.6), (2.0, -0.5, 0.6), (2.0, 0.9, 0.6), (2.0, 0.9, -0.6)])
    scenes = {
        "below its centre": (square(1.0, 0.5, 1, down=True), 0.0), "below a corner": (square(1.0, 0.5, 1, down=True), 0.5),
        "aside": (square(0.7, 0.4, 1, down=True), 1.3), "half below the horizon": (mesh(wall, [[0, 1, 2], [0, 2, 3]], 1), 0.0),
    }  # fmt: skip
    for name, (lamp, x) in scenes.items():
        z = x if name == "below a corner" else 0.0
        truth = 0.7 / math.pi * forms.polygon(lamp.vertices - (x, 0.0, z), (0.0, 1.0, 0.0))
        for direct in STRATEGIES:
            view = point_view((x - 2.0, 1.6, z + 3.0), (x, 0.0, z), 32)
            seen = _point(subject, [FLOOR, lamp], materials, [], view, path_tracer(2, direct), 64)
            yield _z(subject, seen, truth, f"{name}, {direct}")


@SECTION.case("f", "A sphere light lights a floor as its closed form says, above the horizon and across it.",
              "Snyder 1996")  # fmt: skip
def sphere_lights(subject: Subject) -> Iterator[Measured]:
    materials = [material(kd=0.9), material(emission=1.0)]
    for radius, distance, degrees in ((1.0, 2.0, 0), (1.0, 2.0, 90), (1.0, 2.0, 75), (0.5, 3.0, 45), (1.0, 1.3, 60)):
        beta = math.radians(degrees)
        lamp = sphere((distance * math.sin(beta), distance * math.cos(beta), 0.0), radius, 1)
        truth = 0.9 / math.pi * forms.sphere(radius, distance, beta)
        for direct in STRATEGIES:
            view = point_view((-4.0, 1.5, 1.0), ORIGIN, 32)
            seen = _point(subject, [FLOOR, lamp], materials, [], view, path_tracer(2, direct), 64)
            yield _z(subject, seen, truth, f"R {radius}, d {distance}, beta {degrees}, {direct}")


@SECTION.case("sum", "Several lights add up, whichever of them a sample chooses.", "the sum of e, f and i")
def many_lights(subject: Subject) -> Iterator[Measured]:
    materials = [material(kd=0.8), material(emission=1.0)]
    lamp, bulb, point = square(1.0, 0.4, 1, down=True, center=0.8), sphere((-1.5, 1.5, 0.0), 0.5, 1), (0.0, 2.0, 1.0)
    beams = [PointLight(point, grey(0.7)), DirectionalLight((0.0, -0.8, 0.6), grey(0.2))]
    received = [forms.polygon(lamp.vertices, (0.0, 1.0, 0.0)),
                forms.sphere(0.5, math.hypot(1.5, 1.5), math.pi / 4), 0.7 * 2.0 / 5**1.5, 0.2 * 0.8]  # fmt: skip
    for direct in STRATEGIES:
        view = point_view((0.5, 3.0, -3.0), ORIGIN, 32)
        seen = _point(subject, [FLOOR, lamp, bulb], materials, beams, view, path_tracer(2, direct), 64)
        yield _z(subject, seen, 0.8 / math.pi * sum(received), direct)


@SECTION.case("g", "A black sphere shades the sky: rho L (1 - r^2 h / (h^2 + x^2)^(3/2)).", "raybench, g")
def shaded_sky(subject: Subject) -> Iterator[Measured]:
    for r, h, x in ((1.0, 1.0, 1.0), (0.5, 2.0, 0.7)):
        truth = 1 - r * r * h / (h * h + x * x) ** 1.5
        view = point_view((x + 3.0, 1.5, 0.5), (x, 0.0, 0.0), 32)
        for direct in STRATEGIES:
            shapes, materials = [FLOOR, sphere((0.0, h, 0.0), r, 1)], [material(kd=1.0), material()]
            yield _z(subject, _point(subject, shapes, materials, [SKY], view, path_tracer(2, direct), 64), truth,
                     f"r {r}, h {h}, x {x}, {direct}")  # fmt: skip


def _disc(y: float, index: int, down: bool, corners: int = 64) -> Shape:
    """A regular polygon with the area of the unit disc."""
    radius = math.sqrt(2 * math.pi / corners / math.sin(2 * math.pi / corners))
    angle = -2 * np.pi * np.arange(corners) / corners
    rim = np.stack([radius * np.cos(angle), np.full(corners, y), radius * np.sin(angle)], -1)
    k = np.arange(corners)
    faces = np.stack([np.full(corners, corners), k, (k + 1) % corners], -1)
    return mesh(np.concatenate([rim, [[0.0, y, 0.0]]]), faces[:, ::-1] if down else faces, index)


@SECTION.case("h", "Form factors of squares and discs, as the mean of the image of the receiver.", "Howell's catalogue")
def form_factors(subject: Subject) -> Iterator[Measured]:
    floor = square(0.0)
    wall = mesh([(-0.5, 0, -0.5), (-0.5, 1, -0.5), (-0.5, 1, 0.5), (-0.5, 0, 0.5)], [[0, 1, 2], [0, 2, 3]], 1)
    scenes: list[tuple[str, list[Shape], float, float, float]] = [
        ("parallel squares at 1", [floor, square(1.0, 0.5, 1, down=True)], 1.0, 0.19982489569838746, 1.0),
        ("squares with a common edge", [floor, wall], 1.0, 0.20004377607540316, 1.0),
        ("coaxial discs at 1", [_disc(0.0, 0, False), _disc(1.0, 1, True)], 2.0, 0.3819660112501051, math.pi / 4),
    ]
    for name, shapes, height, factor, share in scenes:
        camera = Orthographic((0.0, 0.9, 0.0), ORIGIN, (0.0, 0.0, 1.0), height, (16, 16))
        edge = name == "squares with a common edge"  # where they meet, sampling the light has no bounded variance
        for direct in STRATEGIES[1:] if edge else STRATEGIES:
            means = [subject.image(shapes, [material(kd=1), material(emission=1)], [], camera, path_tracer(2, direct), 16,
                                   seed=seed, sampler="sobol").mean() for seed in range(32)]  # fmt: skip
            yield _z(subject, np.array(means), factor * share, f"{name}, {direct}")


@SECTION.case("i", "Lights without size light a floor by distance and cosine alone, in every shader.", "raybench, i")
def small_lights(subject: Subject) -> Iterator[Measured]:
    shaders = [whitted(), *(path_tracer(2, direct) for direct in STRATEGIES), {"name": "no_shadows", "ambient": 0.0}]
    for h, x, rho in ((1.5, 0.7, 0.5), (3.0, 2.0, 0.9)):
        view = point_view((x, 5.0, 0.0), (x, 0.0, 0.0), up=(0.0, 0.0, 1.0))
        point, sun = PointLight((0.0, h, 0.0), grey(2)), DirectionalLight((0.6, -0.8, 0.0), grey(3))
        for light, truth in ((point, 2 * h / (h * h + x * x) ** 1.5), (sun, 3 * 0.8)):
            seen = [
                subject.image([FLOOR], [material(kd=rho)], [light], view, shader, **MIDDLE)[0, 0] for shader in shaders
            ]
            yield measured(np.array(seen) - rho / math.pi * truth, f"{type(light).__name__}, h {h}, x {x}")


@SECTION.case("j", "Two infinite planes share their light.", "raybench, j")
def planes(subject: Subject) -> Iterator[Measured]:
    ceiling, floor = Plane((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0), Plane(ORIGIN, (0.0, 1.0, 0.0), 1)
    for rho, other in ((0.8, 0.5), (0.3, 0.9)):
        materials = [material(kd=rho, emission=1.0), material(kd=other)]
        top = 1 / (1 - rho * other)
        for target, truth in (((0.0, 1.0, 0.5), top), ((0.0, 0.0, 0.5), other * top)):
            view = point_view((0.0, 0.5, 0.0), target, 8)
            seen = subject.image([ceiling, floor], materials, [], view, path_tracer(120, "bsdf"))
            yield measured(seen - truth, f"rho {rho} and {other}, {'floor' if target[1] == 0 else 'ceiling'}")


@SECTION.case("m", "A sphere's shadow under a point light ends at h tan(asin(r / (h - c))).", "raybench, m")
def shadow(subject: Subject) -> Iterator[Measured]:
    for r, c, h in ((0.5, 1.0, 3.0), (0.2, 0.5, 1.0), (1.0, 1.5, 4.0)):
        edge = h * math.tan(math.asin(r / (h - c)))
        wrong = []
        for side, lit in ((1 - 1e-4, False), (1 + 1e-4, True)):
            view = point_view((2.0 * edge, 0.3 * c, 0.4), (side * edge, 0.0, 0.0))
            shapes, light = [FLOOR, sphere((0.0, c, 0.0), r, 1)], PointLight((0.0, h, 0.0), grey(1))
            seen = subject.image(shapes, [material(kd=0.5), material()], [light], view, whitted(), **MIDDLE)
            wrong.append((seen[0, 0] > 0) != lit)
        yield measured(wrong, f"r {r}, c {c}, h {h}")
