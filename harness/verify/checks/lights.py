"""Direct lighting with closed forms: each case is a scene with several parameters and the exact irradiance.

Point and directional lights may differ by rounding. Area lights are tested by z over replicates, for each of
`direct: light`, `bsdf` and `mis`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from engines.scene import DirectionalLight, Disk, Mesh, Orthographic, PointLight, Shape, SpotLight
from harness.verify import closed_forms as forms
from harness.verify.case import Measurement, Section, measurement
from harness.verify.replicates import STRATEGIES, by_strategy
from harness.verify.scenes import (
    FLOOR,
    ORIGIN,
    WHITE_SKY,
    grey,
    material,
    mesh,
    path_tracer,
    point_view,
    quad,
    sphere,
    square,
    whitted,
)
from harness.verify.subject import Subject
from harness.verify.tolerances import EXACT, NONE_WRONG, Z

SECTION = Section("light")
WALL = [(2.0, -0.5, -0.6), (2.0, -0.5, 0.6), (2.0, 0.9, 0.6), (2.0, 0.9, -0.6)]
TILTED = [(0.5, 1.2, -0.4), (1.1, 0.6, -0.5), (1.3, 0.9, 0.6), (0.4, 1.5, 0.5)]
POLYGONS: list[tuple[str, Mesh, float, float]] = [
    ("half below the horizon", quad(WALL, 1), 0.0, 0.7),
    ("below a corner", square(1.0, 0.5, 1, down=True), 0.5, 0.7),
    ("below its centre", square(1.0, 0.5, 1, down=True), 0.0, 0.5),
    ("aside", square(0.7, 0.4, 1, down=True), 1.3, 0.7),
    ("close", square(0.1, 0.3, 1, down=True), 0.1, 0.2),
    ("far", square(3.0, 1.5, 1, down=True), 2.0, 0.9),
    ("tilted", quad(TILTED, 1), 0.2, 0.8),
    ("three corners", mesh([(-0.7, 0.9, 0.4), (-0.3, 1.3, -0.8), (0.8, 0.7, 0.1)], [[0, 1, 2]], 1), 0.0, 0.6),
]
"""(name, light, x of the point, albedo); z is x below a corner, elsewhere 0."""


@SECTION.case(
    "e", "The irradiance of a polygon light obeys Lambert's formula, also when clipped by the horizon.", Z, "Lambert 1760"
)
def polygons(subject: Subject) -> Iterator[Measurement]:
    for name, emitter, x, rho in subject.subset(POLYGONS, 2):
        z = x if name == "below a corner" else 0.0
        truth = rho / math.pi * forms.polygon(emitter.vertices - np.array([x, 0.0, z]), (0.0, 1.0, 0.0))
        view = point_view((x - 2.0, 0.2, z + 3.0), (x, 0.0, z), 32)  # below the lights
        materials = [material(kd=rho), material(emission=1.0)]
        yield from by_strategy(subject, [FLOOR, emitter], materials, [], view, truth, name)


@SECTION.case("f", "The irradiance of a sphere light has its closed form, above the horizon and across it.", Z, "Snyder 1996")
def sphere_lights(subject: Subject) -> Iterator[Measurement]:
    parameters = (
        (1.0, 2.0, 90),
        (0.5, 3.0, 45),
        (1.0, 2.0, 0),
        (1.0, 2.0, 75),
        (1.0, 1.3, 60),
        (1.0, 1.02, 20),
        (0.2, 0.5, 85),
        (3.0, 4.0, 100),
    )
    for radius, distance, degrees in subject.subset(parameters, 2):
        beta = math.radians(degrees)
        emitter = sphere((distance * math.sin(beta), distance * math.cos(beta), 0.0), radius, 1)
        truth = 0.5 / math.pi * forms.sphere(radius, distance, beta)
        view, materials = point_view((-4.0, 1.5, 1.0), ORIGIN, 32), [material(kd=0.5), material(emission=1.0)]
        where = f"R {radius}, d {distance}, beta {degrees}"
        yield from by_strategy(subject, [FLOOR, emitter], materials, [], view, truth, where)


@SECTION.case("sum", "The radiances of several lights add up.", Z, "the sum of e, f and i")
def many_lights(subject: Subject) -> Iterator[Measurement]:
    materials = [material(kd=0.8), material(emission=1.0)]
    emitter, bulb, point = square(1.0, 0.4, 1, down=True, center=0.8), sphere((-1.5, 1.5, 0.0), 0.5, 1), (0.0, 2.0, 1.0)
    beams = [PointLight(point, grey(0.7)), DirectionalLight((0.0, -0.8, 0.6), grey(0.2))]
    received = [
        forms.polygon(emitter.vertices, (0.0, 1.0, 0.0)),
        forms.sphere(0.5, math.hypot(1.5, 1.5), math.pi / 4),
        0.7 * 2.0 / 5**1.5,
        0.2 * 0.8,
    ]
    kept: list[tuple[str, list[Shape], list[Any], Sequence[int]]] = [
        ("four", [emitter, bulb], beams, (0, 1, 2, 3)),
        ("areas", [emitter, bulb], [], (0, 1)),
        ("one of each", [emitter], beams[:1], (0, 2)),
    ]
    for name, shapes, lights, which in subject.subset(kept, 1):
        truth = 0.8 / math.pi * sum(received[k] for k in which)
        view = point_view((0.5, 3.0, -3.0), ORIGIN, 32)
        yield from by_strategy(subject, [FLOOR, *shapes], materials, lights, view, truth, name)


@SECTION.case(
    "pick", "However one light of several is chosen, the mean is the sum of their irradiances.", Z, "Shirley et al. 1996"
)
def light_choice(subject: Subject) -> Iterator[Measurement]:
    yield from _unequal_lights(subject, [("power", 1), ("bvh", 1), ("spatial", 1)])


@SECTION.case(
    "resample",
    "However many candidates a light sample is picked from, the mean is the sum of the irradiances.",
    Z,
    "Talbot et al. 2005",
)
def light_candidates(subject: Subject) -> Iterator[Measurement]:
    yield from _unequal_lights(subject, [("uniform", 3), ("bvh", 8)])


def _unequal_lights(subject: Subject, rules: Sequence[tuple[str, int]]) -> Iterator[Measurement]:
    """Lights of very different power, which every rule but the even one chooses with very different probabilities; by values
    of `light_sampler` and `light_candidates`."""
    materials = [material(kd=0.8), material(emission=1.0), material(emission=6.0)]
    emitter, bulb = square(1.0, 0.4, 1, down=True, center=0.8), sphere((-0.6, 0.5, 0.2), 0.1, 2)
    beams = [
        PointLight((0.0, 2.0, 1.0), grey(0.7)),
        DirectionalLight((0.0, -0.8, 0.6), grey(0.05)),
        SpotLight((1.0, 1.0, 0.0), (1.0, 0.0, 0.0), grey(3), 40.0, 30.0),
    ]
    away = math.sqrt(0.65)
    received = [
        forms.polygon(emitter.vertices, (0.0, 1.0, 0.0)),
        6 * forms.sphere(0.1, away, math.acos(0.5 / away)),
        0.7 * 2.0 / 5**1.5,
        0.05 * 0.8,
    ]
    truth = 0.8 / math.pi * sum(received)
    shapes, view = [FLOOR, emitter, bulb], point_view((0.5, 3.0, -3.0), ORIGIN, 32)
    for choice, candidates in rules:
        rule = choice if candidates == 1 else f"{choice}, {candidates} candidates"
        options = {"light_sampler": choice, "light_candidates": candidates}
        yield from by_strategy(subject, shapes, materials, beams, view, truth, rule, 2, **options)


@SECTION.case("g", "A floor beside a black sphere has the radiance rho L (1 - r^2 h / (h^2 + x^2)^(3/2)).", Z)
def shaded_sky(subject: Subject) -> Iterator[Measurement]:
    parameters = ((1.0, 1.0, 1.0, 1.0), (0.5, 2.0, 0.7, 0.6), (0.3, 0.4, 0.0, 1.0), (2.0, 2.5, 5.0, 0.9))
    for r, h, x, rho in subject.subset(parameters, 1):
        truth = rho * (1 - r * r * h / (h * h + x * x) ** 1.5)
        view = point_view((x + 3.0 * h, 1.5 * min(h, 1.0), 0.5), (x, 0.0, 0.0), 32)
        shapes, materials = [FLOOR, sphere((0.0, h, 0.0), r, 1)], [material(kd=rho), material()]
        yield from by_strategy(subject, shapes, materials, [WHITE_SKY], view, truth, f"r {r}, h {h}, x {x}", 3)


def _disc(y: float, radius: float, index: int, down: bool) -> Mesh:
    """A regular polygon with the area of a disc."""
    corners = 128
    reach = radius * math.sqrt(2 * math.pi / corners / math.sin(2 * math.pi / corners))
    angle = -2 * np.pi * np.arange(corners) / corners
    rim = np.stack([reach * np.cos(angle), np.full(corners, y), reach * np.sin(angle)], -1)
    k = np.arange(corners)
    faces = np.stack([np.full(corners, corners), k, (k + 1) % corners], -1)
    return mesh(np.concatenate([rim, [[0.0, y, 0.0]]]), faces[:, ::-1] if down else faces, index)


def _wall(height: float) -> Mesh:
    """A rectangle on the edge x = -1/2 of the unit square, which it faces."""
    return quad([(-0.5, 0, -0.5), (-0.5, height, -0.5), (-0.5, height, 0.5), (-0.5, 0, 0.5)], 1)


@SECTION.case("h", "The mean irradiance of a receiver is the form factor, for squares and discs.", Z, "Howell's catalogue")
def form_factors(subject: Subject) -> Iterator[Measurement]:
    """A receiver below the camera, its plane `gap` away from what faces it, fills a `share` of the image."""
    cases: dict[str, list[tuple[str, Sequence[Shape], float, float, float]]] = {"facing": [], "edge": [], "discs": []}
    for gap in (1.0, 0.5, 2.0):
        factor = forms.parallel_rectangles(1 / gap, 1 / gap)
        cases["facing"].append((f"squares at {gap}", [square(0.0), square(gap, 0.5, 1, down=True)], gap, 1.0, factor))
    for height in (1.0, 0.4, 2.5):
        name, factor = f"squares with a common edge, height {height}", forms.perpendicular_rectangles(height, 1.0)
        cases["edge"].append((name, [square(0.0), _wall(height)], 1.0, 1.0, factor))
    for a, b, gap in ((1.0, 1.0, 1.0), (0.5, 2.0, 1.5), (1.0, 0.3, 0.7)):
        shapes, factor = [_disc(0.0, a, 0, False), _disc(gap, b, 1, True)], forms.coaxial_discs(a / gap, b / gap)
        cases["discs"].append((f"coaxial discs {a} and {b} at {gap}", shapes, gap, 2 * a, factor))
    for kind, settings in cases.items():
        share = math.pi / 4 if kind == "discs" else 1.0
        strategies = STRATEGIES[1:] if kind == "edge" else STRATEGIES  # there sampling the light has no bounded variance
        for name, shapes, gap, height, factor in subject.subset(settings, 1):
            camera = Orthographic((0.0, 0.9 * gap, 0.0), ORIGIN, (0.0, 0.0, 1.0), height, (32, 32))
            materials = [material(kd=1), material(emission=1)]
            yield from by_strategy(subject, shapes, materials, [], camera, factor * share, name, 2, strategies)


@SECTION.case("i", "Point and directional lights obey the inverse square and cosine laws in every shader.", EXACT)
def small_lights(subject: Subject) -> Iterator[Measurement]:
    shaders = [whitted(), *(path_tracer(2, direct) for direct in STRATEGIES), {"name": "no_shadows", "ambient": 0.0}]
    for h, x, rho in subject.subset(((1.5, 0.7, 0.5), (3.0, 2.0, 0.9), (0.2, 0.0, 1.0), (40.0, 9.0, 0.3)), 2):
        view = point_view((x, 5.0, 0.0), (x, 0.0, 0.0), up=(0.0, 0.0, 1.0))
        down = math.hypot(h, x)
        point, sun = PointLight((0.0, h, 0.0), grey(2)), DirectionalLight((x / down, -h / down, 0.0), grey(3))
        for light, truth in ((point, 2 * h / (h * h + x * x) ** 1.5), (sun, 3 * h / down)):
            seen = [subject.radiance([FLOOR], [material(kd=rho)], [light], view, shader) for shader in shaders]
            yield measurement(np.array(seen) - rho / math.pi * truth, f"{type(light).__name__}, h {h}, x {x}")
        both = [point, sun, point]
        seen = [subject.radiance([FLOOR], [material(kd=rho)], both, view, shaders[k]) for k in (0, -1)]
        truth = 4 * h / (h * h + x * x) ** 1.5 + 3 * h / down
        yield measurement(np.array(seen) - rho / math.pi * truth, f"three lights, h {h}, x {x}")


@SECTION.case("spot", "A spot light is a point light that falls off linearly in the angle from its axis.", EXACT, "Mitsuba 3")
def spot_lights(subject: Subject) -> Iterator[Measurement]:
    """`degrees`: between the axis and the way to the point that is seen."""
    h, x, cutoff, beam_width = 1.5, 0.7, 30.0, 20.0
    view, toward_point = point_view((x, 5.0, 0.0), (x, 0.0, 0.0), up=(0.0, 0.0, 1.0)), math.atan2(x, h)
    for degrees, share in ((0, 1.0), (19, 1.0), (-25, 0.5), (29, 0.1), (31, 0.0)):
        angle = toward_point + math.radians(degrees)
        light = SpotLight((0.0, h, 0.0), (math.sin(angle), -math.cos(angle), 0.0), grey(2), cutoff, beam_width)
        truth = 0.5 / math.pi * share * 2 * h / math.hypot(h, x) ** 3
        shaders = whitted(), path_tracer(2)
        seen = [subject.radiance([FLOOR], [material(kd=0.5)], [light], view, shader) for shader in shaders]
        yield measurement(np.array(seen) - truth, f"{degrees} degrees off the axis")


@SECTION.case("disk", "The irradiance of a disk light has its closed form, on its axis and off it.", Z, "Howell's catalogue")
def disk_lights(subject: Subject) -> Iterator[Measurement]:
    for radius, height, x in subject.subset(((0.5, 1.0, 0.7), (1.0, 2.0, 0.0), (2.0, 1.5, 1.5)), 1):
        emitter = Disk((0.0, height, 0.0), (0.0, -1.0, 0.0), radius, 1)
        truth = 0.5 / math.pi * forms.parallel_disk(radius, height, x)
        view, materials = point_view((x - 2.0, 0.2, 3.0), (x, 0.0, 0.0), 32), [material(kd=0.5), material(emission=1.0)]
        yield from by_strategy(subject, [FLOOR, emitter], materials, [], view, truth, f"R {radius}, h {height}, x {x}")


@SECTION.case("m", "The shadow of a sphere under a point light ends at h tan(asin(r / (h - c))).", NONE_WRONG)
def shadow(subject: Subject) -> Iterator[Measurement]:
    for r, c, h in subject.subset(((0.5, 1.0, 3.0), (0.2, 0.5, 1.0), (1.0, 1.5, 4.0), (0.01, 0.7, 0.9), (5.0, 20.0, 50.0)), 3):
        edge = h * math.tan(math.asin(r / (h - c)))
        wrong = []
        for side, lit in ((1 - 1e-4, False), (1 + 1e-4, True)):
            view = point_view((2.0 * edge, 0.3 * c, 0.4), (side * edge, 0.0, 0.0))
            shapes, light = [FLOOR, sphere((0.0, c, 0.0), r, 1)], PointLight((0.0, h, 0.0), grey(1))
            seen = subject.radiance(shapes, [material(kd=0.5), material()], [light], view, whitted())
            wrong.append((seen > 0) != lit)
        yield measurement(wrong, f"r {r}, c {c}, h {h}")
