"""Spawned rays: they must not hit the surface that they leave, and must not pass nearby surfaces.

Self-intersections: in a white environment a convex body of albedo 1/2 has a radiance of exactly 1/2, and a shadow ray or
scattered ray that hits the body again loses a whole sample. Leaks: between two plates no light may be seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from engines.scene import Perspective, PointLight, Shape
from harness.verify.case import Measurement, Section, measurement
from harness.verify.scenes import (
    FLOOR,
    WHITE_SKY,
    as_tuple,
    box,
    grey,
    material,
    mesh,
    normalize,
    path_tracer,
    sphere,
    sphere_mesh,
    square,
    triangle,
)
from harness.verify.subject import Subject
from harness.verify.tolerances import NONE_WRONG, Tolerance

SECTION = Section("spawned rays")
SCALES, GAPS = (1e-4, 1.0, 1e3, 1e6), (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


def view(eye: Any, target: Any, fov: float, side: int, up: Any = (0.1, 1.0, 0.2)) -> Perspective:
    return Perspective(as_tuple(eye), as_tuple(target), as_tuple(up), float(fov), "y", (side, side))


def self_intersecting(subject: Subject, shapes: list[Shape], camera: Perspective, direct: str, seed: int = 0) -> Any:
    """(n,) bool: samples that are neither albedo nor environment. `light` tests shadow rays, `bsdf` scattered rays."""
    seen = subject.image(shapes, [material(kd=0.5)], [WHITE_SKY], camera, path_tracer(2, direct), seed=seed).ravel()
    near = np.minimum(np.abs(seen - 0.5), np.abs(seen - 1.0))
    return ~(near <= 1e-4)


def leaking(subject: Subject, scale: float, gap: float, side: int, spp: int = 1) -> Any:
    """(side, side) bool: pixels that see light between two plates of side `scale` that are `gap * scale` apart."""
    plates = [square(0.0, scale), square(gap * scale, scale), square(scale, 0.3 * scale, index=1, down=True)]
    plates = [mesh(subject.cast(plate.vertices), plate.faces, int(plate.materials[0])) for plate in plates]
    camera = view((0.0, 0.5 * gap * scale, 0.1 * scale), (0.0, 0.0, -0.1 * scale), 1.0, side, (0, 1, 0))
    emitter = PointLight((0.1 * scale, scale, 0.0), grey(scale**2))
    return subject.image(plates, [material(kd=0.5), material(emission=1)], [emitter], camera, path_tracer(2), spp) != 0


@SECTION.case(
    "L1",
    "No light leaks into the gap between two plates.",
    Tolerance(
        "wrong",
        0,
        {f"scale {scale:.0e}, gap {gap:.0e}": 0 for scale in SCALES for gap in GAPS if gap >= 1e-3},
        "in float32 rays are offset by 3e-5 of the largest coordinate",
    ),
)
def leaks(subject: Subject) -> Iterator[Measurement]:
    for scale in SCALES:
        for gap in GAPS:
            yield measurement(leaking(subject, scale, gap, 8, 8), f"scale {scale:.0e}, gap {gap:.0e}")


@SECTION.case("L2", "Rays that leave a convex body do not hit it.", NONE_WRONG)
def acne(subject: Subject) -> Iterator[Measurement]:
    side = 64 if subject.quick else 256
    for name, body in (("sphere", sphere()), ("box", box()), ("mesh", sphere_mesh(10))):
        for scale, far in ((1e-4, 0.0), (1.0, 0.0), (1.0, 1e4), (1e4, 0.0), (1e6, 1e6)):
            center = np.array([far, -far, 0.5 * far])
            held = (
                sphere(subject.cast(center), scale)
                if name == "sphere"
                else mesh(subject.cast(center + scale * body.vertices), body.faces)  # type: ignore[union-attr]
            )
            camera = view(center + scale * np.array([3.0, 2.0, 4.0]), center, 25.0, side)
            wrong = [self_intersecting(subject, [held], camera, direct) for direct in ("light", "bsdf")]
            yield measurement(np.concatenate(wrong), f"{name}, scale {scale:.0e}, offset {far:.0e}")


@SECTION.case(
    "L3",
    "No light passes between a plane and a sphere that touches it.",
    Tolerance("wrong", 0, None, "within sqrt(2 r offset) of the contact, offset rays start inside the sphere"),
)
def contact(subject: Subject) -> Iterator[Measurement]:
    for scale in (1e-3, 1.0, 1e3):
        camera = view(scale * np.array([0.3, 0.02, 0.0]), scale * np.array([0.05, 0.0, 0.0]), 10.0, 16)
        inside = PointLight((0.0, scale, 0.0), grey(scale**2))
        seen = subject.image([FLOOR, sphere((0.0, scale, 0.0), scale)], [], [inside], camera, path_tracer(2), 4)
        yield measurement(seen != 0, f"scale {scale:.0e}")


@SECTION.case("S9", "Rays that leave a sphere do not hit it again, at any size and position.", NONE_WRONG, "pbrt's tests")
def spheres(subject: Subject) -> Iterator[Measurement]:
    rng, wrong = np.random.default_rng(9), []
    for trial in range(subject.count(160)):
        radius, away = 10.0 ** rng.uniform(-4, 4), 10.0 ** rng.uniform(-8, 8)
        center, side = away * normalize(rng.normal(size=3)), normalize(rng.normal(size=3))
        eye = subject.cast(center + side * radius * 10.0 ** rng.uniform(0.1, 3))
        distance = np.linalg.norm(subject.cast(center) - eye)
        if distance <= 1.01 * radius:
            continue  # rounding put the eye inside
        fov = min(2 * np.degrees(np.arcsin(radius / distance)), 100.0)
        camera = view(eye, subject.cast(center), fov, 8, np.cross(side, rng.normal(size=3)))
        held = sphere(subject.cast(center), float(subject.cast(radius)))
        wrong += [self_intersecting(subject, [held], camera, direct, trial) for direct in ("light", "bsdf")]
    yield measurement(np.concatenate(wrong))


@SECTION.case("T7", "Rays that leave a triangle do not hit it again, at any size and position.", NONE_WRONG, "pbrt's tests")
def triangles(subject: Subject) -> Iterator[Measurement]:
    rng, wrong = np.random.default_rng(7), []
    for trial in range(subject.count(160)):
        corners = subject.cast(rng.choice([-1, 1], (3, 3)) * 10.0 ** rng.uniform(-8, 8, (3, 3)))
        eye = subject.cast(rng.choice([-1, 1], 3) * 10.0 ** rng.uniform(-8, 8, 3))
        target = rng.dirichlet(np.ones(3)) @ corners
        up = np.cross(target - eye, rng.normal(size=3))
        camera = view(eye, target, 5.0, 8, normalize(up))
        wrong += [self_intersecting(subject, [triangle(corners)], camera, direct, trial) for direct in ("light", "bsdf")]
    yield measurement(np.concatenate(wrong))
