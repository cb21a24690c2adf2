"""Cameras: which part of a scene the image shows, to the pixel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from engines.scene import Disk, Orthographic, Perspective, ThinLens
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.replicates import z_score
from harness.verify.scenes import material, path_tracer, quad
from harness.verify.subject import Subject
from harness.verify.tolerances import LARGEST_Z, NONE_WRONG, Tolerance

SECTION = Section("cameras")
EYE, TARGET, UP = (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
DISTANCE = 3.0
BLURRED = ("focus before", "focus behind", "a spot aside", "a spot below")
LENS = {"in focus": 0, **dict.fromkeys(BLURRED, LARGEST_Z)}


def _seen(subject: Subject, camera: Perspective | Orthographic, half_width: float, half_height: float) -> Array:
    """(height, width) bool: wrong pixels. A light fills the upper right quarter of the image except two rows and one column.

    Rays go through the centres of pixels.
    """
    width, height = camera.resolution
    across, down = camera.principal_point
    x = half_width * (2 * ((np.arange(width) + 0.5) / width - across) - 1) * (-1 if camera.mirror else 1)
    y = half_height * (1 - 2 * ((np.arange(height) + 0.5) / height - down))
    right, top = half_width * (1 - 2 / width), half_height * (1 - 4 / height)  # one column, two rows are left free
    emitter = quad([(0.0, 0.0, 0.0), (right, 0.0, 0.0), (right, top, 0.0), (0.0, top, 0.0)], 0)
    image = subject.image([emitter], [material(emission=1)], [], camera, path_tracer(1), sampler="constant")
    lit = ((x > 0) & (x < right))[None, :] & ((y > 0) & (y < top))[:, None]
    return image != lit


@SECTION.case("cam", "The image shows what field of view, aspect and axis select, upright.", NONE_WRONG, "engines.interface")
def window(subject: Subject) -> Iterator[Measurement]:
    for resolution in ((24, 16), (16, 24)):
        aspect = resolution[0] / resolution[1]
        for axis in ("x", "y"):
            for fov in (10.0, 60.0, 120.0):
                half = DISTANCE * math.tan(math.radians(fov) / 2)
                camera = Perspective(EYE, TARGET, UP, fov, axis, resolution)
                window = (half, half / aspect) if axis == "x" else (half * aspect, half)
                yield measurement(_seen(subject, camera, *window), f"{fov:g} degrees along {axis}, {resolution[0]} wide")
        camera = Orthographic(EYE, TARGET, UP, 2.0, resolution)
        yield measurement(_seen(subject, camera, aspect, 1.0), f"orthographic, {resolution[0]} wide")


@SECTION.case(
    "cam.shift", "The principal point shifts the image, and a mirror exchanges left and right.", NONE_WRONG, "docs/transport.md"
)
def shifted(subject: Subject) -> Iterator[Measurement]:
    half = DISTANCE * math.tan(math.radians(30))
    cameras = {
        "perspective": Perspective(EYE, TARGET, UP, 60.0, "y", (24, 16)),
        "orthographic": Orthographic(EYE, TARGET, UP, 2 * half, (24, 16)),
    }
    for name, camera in cameras.items():
        for point in ((0.25, 0.0), (-0.125, 0.1875)):
            for mirror in (False, True):
                view = replace(camera, principal_point=point, mirror=mirror)
                yield measurement(_seen(subject, view, 1.5 * half, half), f"{name}, {point}{', mirror' * mirror}")


@SECTION.case(
    "cam.clip",
    "Nothing is seen that lies outside of the two distances along the axis of view.",
    NONE_WRONG,
    "docs/transport.md",
)
def clipped(subject: Subject) -> Iterator[Measurement]:
    """A dim square at distance 2 hides a bright one at 3; distances count along the axis, not along rays."""
    squares = [quad([(-9, -9, z), (9, -9, z), (9, 9, z), (-9, 9, z)], k) for k, z in enumerate((1.0, 0.0))]
    materials = [material(emission=0.25), material(emission=1.0)]
    for camera in (Perspective(EYE, TARGET, UP, 100.0, "y", (8, 8)), Orthographic(EYE, TARGET, UP, 4.0, (8, 8))):
        for clip, truth in (
            ((0.5, 2.01), 0.25),
            ((1.99, 9.0), 0.25),
            ((2.01, 3.01), 1.0),
            ((0.1, 1.99), 0.0),
            ((2.01, 2.99), 0.0),
            ((3.01, math.inf), 0.0),
        ):
            view = replace(camera, clip=clip)
            seen = subject.image(squares, materials, [], view, path_tracer(1), sampler="constant")
            yield measurement(seen != truth, f"{type(camera).__name__}, {clip}")


def _lens(radius: float, focus: float, resolution: tuple[int, int], fov: float) -> ThinLens:
    return ThinLens(EYE, TARGET, UP, fov, "y", resolution, radius, focus)


@SECTION.case(
    "lens",
    "A thin lens is sharp at its focus distance, and elsewhere has the circle of confusion of its aperture.",
    Tolerance("z", LENS, LENS),
    "Kolb, Mitchell and Hanrahan 1995",
)
def lens(subject: Subject) -> Iterator[Measurement]:
    """An edge in the focal plane leaves no pixel grey. Elsewhere the share of a bright half plane is a segment of the disk."""
    half = quad([(0, -9, 0), (9, -9, 0), (9, 9, 0), (0, 9, 0)], 0)
    image = subject.image([half], [material(emission=1.0)], [], _lens(0.3, DISTANCE, (16, 16), 30.0), path_tracer(1), 4)
    yield measurement((np.abs(image - (np.arange(16) >= 8)) > 0).astype(float), "in focus", note="pixels that are not sharp")
    for name, radius, focus, edge in (("focus before", 0.5, 1.5, 0.2), ("focus behind", 0.4, 7.0, -0.1)):
        reach = radius * abs(1 - DISTANCE / focus)  # of the circle of confusion, at the plane of the edge
        c = edge / reach
        truth = (math.acos(c) - c * math.sqrt(1 - c * c)) / math.pi
        bright = quad([(edge, -9, 0), (9, -9, 0), (9, 9, 0), (edge, 9, 0)], 0)
        view = _lens(radius, focus, (48, 48), 0.001)
        seen = subject.image([bright], [material(emission=1.0)], [], view, path_tracer(1), 8)
        yield z_score(subject, seen.ravel(), truth, name, 1e-2)
    reach = 0.5 * abs(1 - DISTANCE / 1.5)
    for name, centre in (("a spot aside", (0.3 * reach, 0.4 * reach, 0.0)), ("a spot below", (0.0, -0.5 * reach, 0.0))):
        spot = Disk(centre, (0.0, 0.0, 1.0), 0.35 * reach, 0)
        view = _lens(0.5, 1.5, (48, 48), 0.001)
        seen = subject.image([spot], [material(emission=1.0)], [], view, path_tracer(1), 8)
        yield z_score(subject, seen.ravel(), 0.35**2, name, 1e-2)
