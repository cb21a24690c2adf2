"""Homogeneous media: absorption, single scattering and multiple scattering with known radiance, by the shader
`volumetric_path_tracer`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from engines.scene import DirectionalLight, HomogeneousMedium, Light, Material, Null, Plane, Shape
from harness.verify import closed_forms as forms
from harness.verify.case import Measurement, Section
from harness.verify.replicates import STRATEGIES, means, z_score
from harness.verify.scenes import ORIGIN, WHITE_SKY, Triple, grey, path_tracer, point_view, sphere
from harness.verify.subject import Subject
from harness.verify.tolerances import Z

SECTION = Section("media")
CLEAR = [Material("clear", bsdf=Null())]
UP, DOWN = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
SUN = DirectionalLight(DOWN, grey(1))
SIDEWAYS: Triple = (0.0, 0.0, 1.0)
LARGEST_SHARE = 0.02
"""Of the truth: a test with a larger standard error fails."""


def medium(sigma_t: float | Triple = 1.0, albedo: float = 0.0, g: float = 0.0) -> HomogeneousMedium:
    return HomogeneousMedium("medium", sigma_t if isinstance(sigma_t, tuple) else grey(sigma_t), grey(albedo), g)


def layers(*heights: float) -> list[Shape]:
    """Planes that face up, from the lowest to the highest, with a medium between each and the next."""
    last = len(heights) - 1
    between = [(k - 1 if k else None, k if k < last else None) for k in range(len(heights))]
    return [
        Plane((0.0, y, 0.0), UP, 0, interior=under, exterior=over) for y, (under, over) in zip(heights, between, strict=True)
    ]


def tested(
    subject: Subject,
    shapes: Sequence[Shape],
    media: Sequence[HomogeneousMedium],
    light: Light,
    eye: Triple,
    target: Triple,
    truth: float,
    name: str,
    max_depth: int = 1000,
    **options: Any,
) -> Measurement:
    """The z score of the mean radiance of one pixel."""
    shader = {**path_tracer(max_depth), "name": "volumetric_path_tracer", **options}
    view = point_view(eye, target, 32, up=SIDEWAYS)
    replicates = means(subject, shapes, CLEAR, [light], view, shader, media=media)
    return z_score(subject, replicates, truth, name, LARGEST_SHARE * truth)


@SECTION.case("med.absorb", "What passes media is exp(-sigma_t) to the power of the way, layer by layer.", Z, "Bouguer 1729")
def absorption(subject: Subject) -> Iterator[Measurement]:
    for depths in ((0.2,), (1.0,), (0.5, 1.5)):
        shapes, media = layers(*range(len(depths) + 1)), [medium(depth) for depth in depths]
        yield tested(subject, shapes, media, WHITE_SKY, (0.0, 5.0, 0.0), ORIGIN, math.exp(-sum(depths)), f"{depths}")


@SECTION.case("med.once", "A slab scatters sunlight once as its phase function says, back and through.", Z)
def single_scattering(subject: Subject) -> Iterator[Measurement]:
    for sigma_t, albedo, g in subject.subset(((1.0, 0.8, 0.0), (1.0, 0.8, 0.5), (2.0, 0.5, -0.3)), 2):
        media = [medium(sigma_t, albedo, g)]
        for name, eye, truth in (
            ("back", 5.0, forms.back_scattering(sigma_t, albedo, g)),
            ("through", -4.0, forms.forward_scattering(sigma_t, albedo, g)),
        ):
            where = f"{name}, sigma_t {sigma_t}, g {g}"
            yield tested(subject, layers(0.0, 1.0), media, SUN, (0.0, eye, 0.0), (0.0, 0.5, 0.0), truth, where, 2)


@SECTION.case(
    "med.half", "A half-space of isotropic scatterers reflects by the product of two H functions.", Z, "Chandrasekhar 1950"
)
def half_space(subject: Subject) -> Iterator[Measurement]:
    shapes = [Plane(ORIGIN, UP, 0, interior=0)]
    for cosine in subject.subset((1.0, 0.5), 1):
        eye = (5.0 * math.sqrt(1.0 - cosine**2), 5.0 * cosine, 0.0)
        truth = forms.half_space(0.8, 1.0, cosine)
        yield tested(subject, shapes, [medium(1.0, 0.8)], SUN, eye, ORIGIN, truth, f"cosine {cosine}", 60, rr_depth=4)


@SECTION.case("med.white", "A ball of medium that absorbs nothing, of any colour, vanishes in a white surrounding.", Z)
def white(subject: Subject) -> Iterator[Measurement]:
    """Channels differ in how far light flies, and share paths: each in turn is the one that is looked at."""
    for sigma_t, g in subject.subset(((1.0, 0.8), (0.5, 0.0)), 1):
        for direct in STRATEGIES:
            yield _white(subject, grey(sigma_t), g, direct)
    for sigma_t in ((0.5, 2.0, 4.0), (2.0, 4.0, 0.5), (4.0, 0.5, 2.0), (0.0, 1.0, 2.0)):
        yield _white(subject, sigma_t, 0.5, "mis")


def _white(subject: Subject, sigma_t: Triple, g: float, direct: str) -> Measurement:
    ball, media = replace(sphere(), interior=0), [medium(sigma_t, 1.0, g)]
    where = f"sigma_t {sigma_t}, g {g}, {direct}"
    return tested(subject, [ball], media, WHITE_SKY, (0.3, 5.0, 0.0), (0.3, 0.0, 0.0), 1.0, where, direct=direct)
