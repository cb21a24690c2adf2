"""Images at infinity: how they are turned, where their rows lie, and how they are sampled."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from engines.scene import EnvironmentLight, Perspective
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.checks.models import looked_up
from harness.verify.replicates import STRATEGIES, z_score
from harness.verify.scenes import FLOOR, ORIGIN, Triple, as_tuple, material, path_tracer, point_view
from harness.verify.subject import Subject
from harness.verify.tolerances import Tolerance, Z

SECTION = Section("sky")
TEXELS = np.random.default_rng(23).random((6, 10))
UNTURNED = np.eye(3)
TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
MIRRORED = TURNED * np.array([[1.0], [1.0], [-1.0]])


def _sky(texels: Array, rotation: Array, rows: str = "cells") -> EnvironmentLight:
    """A grey image; `rotation` takes its directions to the scene's."""
    a, b, c = map(as_tuple, rotation)
    return EnvironmentLight((1.0, 1.0, 1.0), np.repeat(texels[:, :, None], 3, axis=2), (a, b, c), rows)


@SECTION.case(
    "sky",
    "The sky is seen where its image, its rotation and its rows put it.",
    Tolerance("absolute", 1e-9, 1e-4),
    "docs/transport.md",
)
def seen(subject: Subject) -> Iterator[Measurement]:
    """Six views of 90 degrees show every direction."""
    views: tuple[tuple[Triple, Triple], ...] = (
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
        ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
        ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),
    )
    places = 2 * (np.arange(17) + 0.5) / 17 - 1
    for name, rotation in (("as it is", UNTURNED), ("turned", TURNED), ("mirrored", MIRRORED)):
        for rows in ("cells", "poles"):
            errors = []
            for forward, up in views:
                right = np.cross(forward, up)
                d = np.add.outer(np.array(forward), np.zeros((17, 17))) + np.multiply.outer(right, np.tile(places, (17, 1)))
                d = (d - np.multiply.outer(np.array(up), np.tile(places[:, None], (1, 17)))).reshape(3, -1)
                truth = looked_up(TEXELS, rotation.T @ d / np.linalg.norm(d, axis=0), rows == "poles")
                camera = Perspective(ORIGIN, forward, up, 90.0, "y", (17, 17))
                sky = _sky(TEXELS, rotation, rows)
                image = subject.image([], [material()], [sky], camera, path_tracer(1), sampler="constant")
                errors.append(image.ravel() - truth)
            yield measurement(np.concatenate(errors), f"{name}, {rows}")


@SECTION.case("sky.floor", "A floor under a turned sky shows the integral of the image, by every strategy.", Z)
def floor(subject: Subject) -> Iterator[Measurement]:
    nodes, weights = np.polynomial.legendre.leggauss(300)
    y, u = (each.ravel() for each in np.meshgrid((nodes + 1) / 2, (np.arange(900) + 0.5) / 900, indexing="ij"))
    ring, phi = np.sqrt(1 - y * y), 2 * math.pi * u
    d, weight = np.stack([ring * np.cos(phi), y, ring * np.sin(phi)]), np.repeat(weights / 2, 900) / 900
    texels = TEXELS**6  # uneven, so that a sky sampled elsewhere has another mean
    for name, rotation, rows in (("turned", TURNED, "cells"), ("mirrored", MIRRORED, "poles")):
        truth = 0.8 * 2 * float((looked_up(texels, rotation.T @ d, rows == "poles") * y * weight).sum())
        for direct in STRATEGIES:
            sky, view = _sky(texels, rotation, rows), point_view((0.3, 1.5, 4.0), ORIGIN, 48)
            image = subject.image([FLOOR], [material(kd=0.8)], [sky], view, path_tracer(2, direct), 16)
            yield z_score(subject, image.ravel(), truth, f"{name}, {direct}", 1e-2)
