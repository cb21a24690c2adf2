"""Samplers, tested through images: unbiased means, and the rate of convergence of the error.

The first two dimensions of a sampler are the position in the pixel. A depth map of a plane, and the albedo of an edge through
every pixel, are therefore two-dimensional integrands with known integrals; an image has 256 of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from engines.scene import Orthographic, Perspective, Plane, Scene
from harness.verify import closed_forms as forms
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.replicates import means, z_score
from harness.verify.scenes import FLOOR, ORIGIN, material, mesh, path_tracer, point_view, scene, sphere
from harness.verify.subject import Subject
from harness.verify.tolerances import Tolerance, Z

SECTION = Section("sampling")
SAMPLERS = ("random", "stratified", "halton", "sobol")
SIDE = 16
GROUPS = 16
SLOPE = Tolerance("absolute", 0.15, 0.15)


class Integrands(NamedTuple):
    """A scene, the shader that evaluates the integrands, their integrals (SIDE, SIDE), and the expected slopes."""

    scene: Scene
    shader: Any
    truth: Array
    slopes: dict[str, float]


def _smooth() -> Integrands:
    """Distance to a plane, sqrt(1 + x^2 + y^2); integrals by Gauss-Legendre quadrature."""
    view = Perspective((0.0, 0.0, 1.0), ORIGIN, (0.0, 1.0, 0.0), 120.0, "y", (SIDE, SIDE))
    farthest = (0.0, 0.0, -2.0)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(-1, 1, SIDE + 1) * math.tan(math.pi / 3)
    places = ((edges[1:] + edges[:-1])[:, None] + (edges[1:] - edges[:-1])[:, None] * nodes) / 2
    x, y = places[None, :, None, :], places[:, None, :, None]
    distance = np.einsum("ijkl,k,l->ij", np.sqrt(1 + x * x + y * y), weights / 2, weights / 2)
    wall = Plane(ORIGIN, (0.0, 0.0, 1.0), 0)
    slopes = {"random": -0.5, "stratified": -1.0, "halton": -0.9, "sobol": -1.6}
    return Integrands(
        scene([wall], [material(kd=1)], camera=view),
        {"name": "depth_map", "max_point": farthest},
        1 - distance / (1.1 * 3.0),
        slopes,
    )


def _edges(subject: Subject) -> Integrands:
    """A slanted edge through every pixel; the area under it is half the sum of its two heights."""
    rng = np.random.default_rng(7)
    heights = subject.cast(np.round(rng.uniform(0.05, 0.95, (2, SIDE, SIDE)), 3))
    row, column = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    x, y = column - SIDE / 2, SIDE / 2 - 1 - row
    flat = np.zeros((SIDE, SIDE))
    corners = [(x, y, flat), (x + 1, y, flat), (x + 1, y + heights[1], flat), (x, y + heights[0], flat)]
    vertices = np.stack([np.stack(corner, -1) for corner in corners], 2).reshape(-1, 3)
    faces = 4 * np.arange(SIDE * SIDE)[:, None, None] + np.array([(0, 1, 2), (0, 2, 3)])
    view = Orthographic((0.0, 0.0, 5.0), ORIGIN, (0.0, 1.0, 0.0), float(SIDE), (SIDE, SIDE))
    slopes = {"random": -0.5, "stratified": -0.72, "halton": -0.72, "sobol": -0.72}
    return Integrands(
        scene([mesh(vertices, faces.reshape(-1, 3))], [material(kd=1)], camera=view), "albedo", heights.mean(axis=0), slopes
    )


@SECTION.case("q.mean", "The mean of every sampler is the integral.", Z)
def average(subject: Subject) -> Iterator[Measurement]:
    emitter = sphere((1.0, math.sqrt(3.0), 0.0), 1.0, 1)
    truth = 0.9 / math.pi * forms.sphere(1.0, 2.0, math.pi / 6)
    view = point_view((-4, 1.5, 1), ORIGIN, 8 if subject.quick else 16)
    materials = [material(kd=0.9), material(emission=1)]
    lit = scene([FLOOR, emitter], materials, camera=view)
    for sampler in subject.accepted(SAMPLERS, lit, path_tracer(2)):
        chosen = _chosen(sampler, 4)
        seen = means(subject, [FLOOR, emitter], materials, [], view, path_tracer(2), 4, sampler=chosen)
        yield z_score(subject, seen, truth, sampler)


def _chosen(sampler: str, spp: int) -> Any:
    return {"name": sampler, "strata": spp} if sampler == "stratified" else sampler


@SECTION.case("q.slope", "For a smooth integrand the error falls at the rate of the sampler.", SLOPE, "Owen 1997")
def smooth_slopes(subject: Subject) -> Iterator[Measurement]:
    yield from _slopes(subject, _smooth())


@SECTION.case("q.edge", "For an edge the error falls at the rate of the sampler.", SLOPE, "Mitchell 1996")
def edge_slopes(subject: Subject) -> Iterator[Measurement]:
    yield from _slopes(subject, _edges(subject))


def _slopes(subject: Subject, integrands: Integrands) -> Iterator[Measurement]:
    """The distance of the 99 % interval of the slope from the expected slope; a steeper slope is an error for `random` only."""
    for sampler in subject.accepted(list(integrands.slopes), integrands.scene, integrands.shader):
        expected = integrands.slopes[sampler]
        counts = [4**k for k in range(1, 5 if subject.quick or subject.tracing == "float32" else 6)]
        squares = np.array([(seen - integrands.truth) ** 2 for seen in _images(subject, integrands, sampler, counts)])
        slope, error = slope_of(counts, squares.reshape(len(counts), -1))
        excess = abs(slope - expected) if sampler == "random" else max(slope - expected, 0.0)
        yield measurement(
            max(excess - 2.95 * error, 0.0), sampler, note=f"slope {slope:.3f} +- {2.95 * error:.3f}, expected {expected}"
        )


def _images(subject: Subject, integrands: Integrands, sampler: str, counts: Sequence[int]) -> Iterator[Array]:
    """The red channel (SIDE, SIDE) for each number of samples; `stratified` needs a renderer for each."""
    renderer, done = None, 0
    for spp in counts:
        if renderer is None or sampler == "stratified":
            renderer = subject.renderer(integrands.scene, shader=integrands.shader, sampler=_chosen(sampler, spp), seed=3)
            done = 0
        yield renderer.render(spp - done).mean()[:, :, 0]
        done = spp


def slope_of(counts: Sequence[int], squares: Array) -> tuple[float, float]:
    """Slope of log RMSE over log n, and its standard error, from squared errors `squares` (counts, replicates).

    Jackknife over groups of replicates: the points of one replicate share samples, those of two do not.
    """

    def fitted(part: Array) -> float:
        return float(np.polyfit(np.log(counts), np.log(part.mean(axis=1)) / 2, 1)[0])

    group = np.arange(squares.shape[1]) % GROUPS
    left_out = np.array([fitted(squares[:, group != k]) for k in range(GROUPS)])
    error = math.sqrt((GROUPS - 1) / GROUPS * float(np.sum((left_out - left_out.mean()) ** 2)))
    return fitted(squares), error
