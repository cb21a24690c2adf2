"""White furnaces: closed rooms and bodies under a uniform environment, whose radiance is known at every path depth.

Estimators without variance may differ by rounding; the others are tested by z over replicates (see `replicates`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from engines.scene import EnvironmentLight, Plane, PointLight
from harness.verify import closed_forms as forms
from harness.verify.case import Measurement, Section, measurement
from harness.verify.replicates import STRATEGIES, by_strategy, means, z_score
from harness.verify.scenes import (
    FLOOR,
    FRONT_CAMERA,
    ORIGIN,
    WHITE_SKY,
    box,
    grey,
    material,
    path_tracer,
    point_view,
    sphere,
    sphere_mesh,
)
from harness.verify.subject import Subject
from harness.verify.tolerances import EXACT, NONE_WRONG, Tolerance, Z

SECTION = Section("light")
CORNER = {"eye": (0.2, 0.1, 0.3), "target": (0.9, -0.2, 0.1)}


@SECTION.case(
    "px", "Every pixel of an image is rendered, at any image size.", NONE_WRONG, "MobileRT, which omits two thirds of 30 x 30"
)
def sizes(subject: Subject) -> Iterator[Measurement]:
    for width, height in subject.subset(((40, 40), (30, 30), (1, 1), (257, 3), (100, 100), (15, 7), (3, 131), (64, 33)), 4):
        view = replace(FRONT_CAMERA, resolution=(width, height))
        seen = subject.image([], [], [WHITE_SKY], view, path_tracer(1, "bsdf"))
        yield measurement((seen != 1) | (seen.shape != (height, width)), f"{width} x {height}")


@SECTION.case(
    "a", "A closed furnace has the radiance E (1 - rho^D) / (1 - rho), whatever its shape.", Tolerance("absolute", 1e-12, 1e-5)
)
def furnace(subject: Subject) -> Iterator[Measurement]:
    parameters = (
        (0.5, 0.5, 1),
        (0.5, 0.5, 2),
        (0.5, 0.5, 5),
        (2.0, 0.8, 3),
        (0.3, 0.9, 20),
        (7.0, 0.05, 4),
        (0.01, 0.99, 100),
        (1.0, 0.37, 9),
    )
    for name, hollow in (("box", box()), ("mesh", sphere_mesh(8)), ("sphere", sphere())):
        for emission, rho, depth in subject.subset(parameters, 5):
            walls = material(kd=rho, emission=emission, two_sided=True)
            truth = emission * (1 - rho**depth) / (1 - rho)
            seen = subject.image([hollow], [walls], [], point_view(**CORNER, side=4), path_tracer(depth, "bsdf"))
            yield measurement(seen / truth - 1, f"{name}, E {emission}, rho {rho}, D {depth}")


@SECTION.case("a.mis", "The furnace has the same radiance with light sampling and MIS.", Z)
def furnace_mis(subject: Subject) -> Iterator[Measurement]:
    """`direct: light` only in the sphere: in a box its variance is unbounded near the corners."""
    for name, hollow, strategies in (("box", box(), ("mis",)), ("sphere", sphere(), STRATEGIES)):
        for emission, rho, depth in subject.subset(((0.5, 0.5, 3), (0.5, 0.5, 2), (0.2, 0.8, 6), (0.9, 0.1, 4)), 1):
            walls = material(kd=rho, emission=emission, two_sided=True)
            truth, view = emission * (1 - rho**depth) / (1 - rho), point_view(**CORNER, side=32)
            where = f"{name}, E {emission}, rho {rho}, D {depth}"
            yield from by_strategy(subject, [hollow], [walls], [], view, truth, where, 1, strategies, depth)


@SECTION.case("rr", "Russian roulette does not change the mean, E / (1 - rho).", Z)
def roulette_mean(subject: Subject) -> Iterator[Measurement]:
    for rho, rr_depth in subject.subset(((0.5, 1), (0.7, 3), (0.5, 2), (0.9, 1), (0.3, 4)), 2):
        walls = material(kd=rho, emission=0.25 * (1 - rho), two_sided=True)
        shader = path_tracer(10_000, "bsdf", rr_depth)
        view = point_view(**CORNER, side=26 if subject.quick else 40)
        seen = means(subject, [box()], [walls], [], view, shader)
        yield z_score(subject, seen, 0.25, f"rho {rho}, from segment {rr_depth}")


@SECTION.case("rr2", "Russian roulette has the second moment E^2 (1 + rho) / ((1 - rho) (1 - rho^2 / q)).", Z)
def roulette_square(subject: Subject) -> Iterator[Measurement]:
    """With roulette from the first segment, the survival probability min(beta, 0.95) is rho at every scattering event."""
    for rho in subject.subset((0.5, 0.7, 0.2, 0.9), 2):
        walls = material(kd=rho, emission=1 - rho, two_sided=True)
        shader = path_tracer(10_000, "bsdf", 1)
        seen = means(subject, [box()], [walls], [], point_view(**CORNER, side=48), shader, power=2)
        truth = forms.roulette_second_moment(1 - rho, rho, survival=rho)
        yield z_score(subject, seen, truth, f"rho {rho}", 2e-2)


@SECTION.case("c", "In a uniform environment the radiance of a convex body is its albedo.", EXACT)
def convex(subject: Subject) -> Iterator[Measurement]:
    view = point_view((0.5, 3.0, 2.0), ORIGIN, 8)
    for rho in (0.3, 0.7, 1.0):
        for direct in STRATEGIES:
            seen = [
                subject.image([body], [material(kd=rho)], [WHITE_SKY], view, path_tracer(2, direct))
                for body in (sphere(), box(), sphere_mesh(8))
            ]
            yield measurement(np.concatenate(seen).ravel() - rho, f"rho {rho}, {direct}")


@SECTION.case("c.sky", "An environment a + b cos(theta) gives a floor the radiance rho (a + 2 b / 3).", Z)
def graded(subject: Subject) -> Iterator[Measurement]:
    cosine = np.maximum(np.cos(np.pi * (np.arange(512) + 0.5) / 512), 0.0)
    for a, b, rho in subject.subset(((0.2, 0.6, 0.8), (0.0, 1.0, 0.5), (0.25, 0.02, 0.9), (0.05, 0.3, 1.0)), 1):
        sky = EnvironmentLight((1.0, 1.0, 1.0), np.repeat(a + b * cosine, 3 * 8).reshape(512, 8, 3))
        truth, view = rho * (a + 2 * b / 3), point_view((0.3, 1.5, 4.0), ORIGIN, 32)
        yield from by_strategy(subject, [FLOOR], [material(kd=rho)], [sky], view, truth, f"a {a}, b {b}, rho {rho}")


@SECTION.case("d", "A point light at the centre of a sphere gives 1 - rho^k after k reflections.", EXACT)
def centred(subject: Subject) -> Iterator[Measurement]:
    """The intensity is pi (1 - rho) / rho r^2."""
    for rho, radius in subject.subset(((0.5, 1.0), (0.8, 0.3), (0.2, 40.0), (0.95, 1.0)), 2):
        view = point_view((0.3 * radius, 0.0, 0.1 * radius), (0.5 * radius, 0.7 * radius, 0.2 * radius), 4)
        light = PointLight(ORIGIN, grey(math.pi * (1 - rho) / rho * radius**2))
        for k in (1, 2, 5, 12):
            seen = subject.image([sphere(ORIGIN, radius)], [material(kd=rho)], [light], view, path_tracer(k + 1))
            yield measurement(seen - (1 - rho**k), f"rho {rho}, r {radius}, k {k}")


@SECTION.case("d.off", "A point light off the centre of a sphere gives rho/pi (I cos/d^2 + rho/(1 - rho) I/r^2).", Z)
def off_centre(subject: Subject) -> Iterator[Measurement]:
    for y, rho, radius in subject.subset(((0.5, 0.5, 1.0), (-0.6, 0.3, 2.0), (0.1, 0.6, 0.5), (0.8, 0.2, 1.0)), 2):
        point = np.array([0.3 * radius, 0.0, -radius * math.sqrt(1 - 0.09)])
        to_light = np.array([0.0, y, 0.0]) - point
        distance = float(np.linalg.norm(to_light))
        near = float(to_light @ -point) / radius / distance**3
        truth = rho / math.pi * radius**2 * (near + rho / (1 - rho) / radius**2)
        side = 8 if subject.quick else 12
        view = point_view((0.3 * radius, 0.0, 0.1 * radius), (0.3 * radius, 0.0, -radius), side)
        room, light = [sphere(ORIGIN, radius)], PointLight((0.0, y, 0.0), grey(radius**2))
        seen = means(subject, room, [material(kd=rho)], [light], view, path_tracer(30))
        yield z_score(subject, seen, truth, f"y {y}, rho {rho}, r {radius}")


@SECTION.case(
    "j",
    "Two infinite parallel planes have radiances 1/(1 - rho_1 rho_2) and rho_2 times that.",
    Tolerance("absolute", 1e-9, 1e-4, "grazing rays are 65,000 times as long as the planes are apart"),
)
def planes(subject: Subject) -> Iterator[Measurement]:
    """Planes are not sampled as lights, so one strategy stands for all."""
    for rho, other, gap in subject.subset(((0.8, 0.5, 1.0), (0.3, 0.9, 0.2), (0.5, 0.5, 30.0), (0.0, 0.7, 1.0)), 2):
        ceiling, floor = Plane((0.0, gap, 0.0), (0.0, -1.0, 0.0), 0), Plane(ORIGIN, (0.0, 1.0, 0.0), 1)
        materials = [material(kd=rho, emission=1.0), material(kd=other)]
        top = 1 / (1 - rho * other)
        for target, truth in (((0.0, gap, 0.5 * gap), top), ((0.0, 0.0, 0.5 * gap), other * top)):
            view = point_view((0.0, 0.5 * gap, 0.0), target, 8)
            seen = subject.image([ceiling, floor], materials, [], view, path_tracer(120, "bsdf"))
            where = "floor" if target[1] == 0 else "ceiling"
            yield measurement(seen - truth, f"rho {rho} and {other}, gap {gap}, {where}")
