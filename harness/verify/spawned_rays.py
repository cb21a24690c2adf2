"""Rays that leave a surface: they must not meet it again, nor jump over what is near.

Seen from outside: in a white sky a convex body of albedo 1/2 is exactly 1/2 bright, and every shadow ray or scattered
ray that meets the body again takes a whole sample away; between two plates no light may be seen at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from engines.scene import Perspective, PointLight, Shape
from harness.verify.case import Measured, Section, measured
from harness.verify.stage import (
    FLOOR,
    SKY,
    ball,
    box,
    grey,
    material,
    mesh,
    path_tracer,
    sphere,
    square,
    triangle,
    triple,
    unit,
)  # fmt: skip
from harness.verify.subject import Subject

SECTION = Section("spawned rays")
SCALES, GAPS = (1e-4, 1.0, 1e3, 1e6), (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


def view(eye: Any, target: Any, fov: float, side: int, up: Any = (0.1, 1.0, 0.2)) -> Perspective:
    return Perspective(triple(eye), triple(target), triple(up), float(fov), "y", (side, side))


def met_again(subject: Subject, shapes: list[Shape], camera: Perspective, direct: str, seed: int = 0) -> Any:
    """Samples that are neither the albedo nor the sky; `light` asks shadow rays, `bsdf` scattered ones."""
    seen = subject.image(shapes, [material(kd=0.5)], [SKY], camera, path_tracer(2, direct), seed=seed).ravel()
    near = np.minimum(np.abs(seen - 0.5), np.abs(seen - 1.0))
    return ~(near <= 1e-4)


def leaking(subject: Subject, scale: float, gap: float, side: int, spp: int = 1) -> Any:
    """Pixels between two plates of side `scale`, `gap` times that apart, that see light: (side, side) bool."""
    plates = [square(0.0, scale), square(gap * scale, scale), square(scale, 0.3 * scale, index=1, down=True)]
    plates = [mesh(subject.cast(plate.vertices), plate.faces, int(plate.materials[0])) for plate in plates]
    camera = view((0.0, 0.5 * gap * scale, 0.1 * scale), (0.0, 0.0, -0.1 * scale), 1.0, side, (0, 1, 0))
    lamp = PointLight((0.1 * scale, scale, 0.0), grey(scale**2))
    return subject.image(plates, [material(kd=0.5), material(emission=1)], [lamp], camera, path_tracer(2), spp) != 0


@SECTION.case("L1", "No light leaks into the gap between two plates.", "raybench, L1")
def leaks(subject: Subject) -> Iterator[Measured]:
    for scale in SCALES:
        for gap in GAPS:
            yield measured(leaking(subject, scale, gap, 8, 8), f"scale {scale:.0e}, gap {gap:.0e}")


@SECTION.case("L2", "Rays that leave a convex body never meet it.", "raybench, L2")
def acne(subject: Subject) -> Iterator[Measured]:
    side = 64 if subject.quick else 256
    for name, body in (("sphere", sphere()), ("box", box()), ("mesh", ball(10))):
        for scale, far in ((1e-4, 0.0), (1.0, 0.0), (1.0, 1e4), (1e4, 0.0), (1e6, 1e6)):
            center = np.array([far, -far, 0.5 * far])
            held = (sphere(subject.cast(center), scale) if name == "sphere"
                    else mesh(subject.cast(center + scale * body.vertices), body.faces))  # type: ignore[union-attr]  # fmt: skip
            camera = view(center + scale * np.array([3.0, 2.0, 4.0]), center, 25.0, side)
            wrong = [met_again(subject, [held], camera, direct) for direct in ("light", "bsdf")]
            yield measured(np.concatenate(wrong), f"{name}, scale {scale:.0e}, offset {far:.0e}")


@SECTION.case("L3", "Light does not pass where a sphere rests on a plane.", "raybench, L3")
def contact(subject: Subject) -> Iterator[Measured]:
    for scale in (1e-3, 1.0, 1e3):
        camera = view(scale * np.array([0.3, 0.02, 0.0]), scale * np.array([0.05, 0.0, 0.0]), 10.0, 16)
        inside = PointLight((0.0, scale, 0.0), grey(scale**2))
        seen = subject.image([FLOOR, sphere((0.0, scale, 0.0), scale)], [], [inside], camera, path_tracer(2), 4)
        yield measured(seen != 0, f"scale {scale:.0e}")


@SECTION.case("S9", "A ray that leaves a sphere never meets it again, whatever its size and place.", "pbrt's tests")
def spheres(subject: Subject) -> Iterator[Measured]:
    rng, wrong = np.random.default_rng(9), []
    for trial in range(subject.count(160)):
        radius, away = 10.0 ** rng.uniform(-4, 4), 10.0 ** rng.uniform(-8, 8)
        center, side = away * unit(rng.normal(size=3)), unit(rng.normal(size=3))
        eye = subject.cast(center + side * radius * 10.0 ** rng.uniform(0.1, 3))
        distance = np.linalg.norm(subject.cast(center) - eye)
        if distance <= 1.01 * radius:
            continue  # rounding put the eye inside
        fov = min(2 * np.degrees(np.arcsin(radius / distance)), 100.0)
        camera = view(eye, subject.cast(center), fov, 8, np.cross(side, rng.normal(size=3)))
        held = sphere(subject.cast(center), float(subject.cast(radius)))
        wrong += [met_again(subject, [held], camera, direct, trial) for direct in ("light", "bsdf")]
    yield measured(np.concatenate(wrong))


@SECTION.case("T7", "A ray that leaves a triangle never meets it again, whatever its size and place.", "pbrt's tests")
def triangles(subject: Subject) -> Iterator[Measured]:
    rng, wrong = np.random.default_rng(7), []
    for trial in range(subject.count(160)):
        corners = subject.cast(rng.choice([-1, 1], (3, 3)) * 10.0 ** rng.uniform(-8, 8, (3, 3)))
        eye = subject.cast(rng.choice([-1, 1], 3) * 10.0 ** rng.uniform(-8, 8, 3))
        target = rng.dirichlet(np.ones(3)) @ corners
        up = np.cross(target - eye, rng.normal(size=3))
        camera = view(eye, target, 5.0, 8, unit(up))
        wrong += [met_again(subject, [triangle(corners)], camera, direct, trial) for direct in ("light", "bsdf")]
    yield measured(np.concatenate(wrong))
