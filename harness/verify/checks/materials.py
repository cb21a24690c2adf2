"""Materials: white furnace, conservation of energy, reciprocity."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from engines.scene import Conductor, DirectionalLight, Material, Plane, Shape
from harness.verify import closed_forms as forms
from harness.verify.case import Measurement, Section, measurement
from harness.verify.checks.glass import cosine_of, fresnel, toward
from harness.verify.replicates import STRATEGIES, by_strategy
from harness.verify.scenes import FLOOR, ORIGIN, WHITE_SKY, direction, grey, material, path_tracer, point_view, sphere, whitted
from harness.verify.subject import Subject
from harness.verify.tolerances import EXACT, MANY_EVENTS, Z

SECTION = Section("materials")
LOSSLESS: dict[str, Material] = {
    "matte": material(kd=1),
    "mirror": material(ks=1),
    "half a mirror": material(kd=0.5, ks=0.5),
    "mostly mirror": material(kd=0.25, ks=0.75),
    "glass": material(ks=1, kt=1, ior=1.5, fresnel=True),
    "glass without Fresnel": material(ks=0.3, kt=0.7, ior=1.5),
    "clear": material(kt=1, ior=1.33),
    "frosted": material(kd=0.2, ks=0.3, kt=0.5, ior=1.3),
    "coated": material(kd=0.4, ks=0.6, kt=0.6, ior=1.5, fresnel=True),
    "coloured": Material("m", (0.2, 0.25, 0.3), (0.3, 0.35, 0.3), (0.5, 0.4, 0.4), 1.4),
}
ABSORBING: dict[str, Material] = {
    "matte": material(kd=0.7),
    "mirror": material(ks=0.9),
    "mixed": material(kd=0.3, ks=0.4),
    "pane": material(ks=0.2, kt=0.5, ior=1.5),
    "glass": material(ks=1, kt=1, ior=1.5, fresnel=True),
    "diamond": material(ks=0.9, kt=0.95, ior=2.4, fresnel=True),
    "frosted": material(kd=0.2, ks=0.5, kt=0.6, ior=1.3, fresnel=True),
}
ANGLES = (0, 20, 45, 70, 85)


@SECTION.case("wf", "In a white furnace every lossless opaque material is white.", EXACT)
def white(subject: Subject) -> Iterator[Measurement]:
    """Exact for `direct: bsdf`; with light sampling only where the material has one lobe."""
    view = point_view((0.5, 3.0, 2.0), ORIGIN, 8)
    for name in ("matte", "mirror", "half a mirror", "mostly mirror"):
        for direct in STRATEGIES if name in ("matte", "mirror") else ("bsdf",):
            seen = subject.image([sphere()], [LOSSLESS[name]], [WHITE_SKY], view, path_tracer(9, direct))
            yield measurement(seen - 1, f"{name}, {direct}")


@SECTION.case("wf.glass", "In a white furnace every lossless transparent body is invisible.", MANY_EVENTS)
def white_glass(subject: Subject) -> Iterator[Measurement]:
    view = point_view((0.5, 3.0, 2.0), (0.5, 0.3, 0.2), 8)
    for name in ("glass", "glass without Fresnel", "clear", "frosted", "coated"):
        seen = subject.image([sphere()], [LOSSLESS[name]], [WHITE_SKY], view, path_tracer(2000, "bsdf"))
        yield measurement(seen - 1, name)


@SECTION.case("wf.z", "In a white furnace the mean radiance of every mixture of lobes is white, by every strategy.", Z)
def white_mixtures(subject: Subject) -> Iterator[Measurement]:
    view = point_view((0.5, 3.0, 2.0), (0.5, 0.3, 0.2), 32)
    for name in subject.subset(("half a mirror", "mostly mirror", "frosted", "coated", "coloured"), 1):
        strategies = STRATEGIES if name == "coloured" else ("light", "mis")
        yield from by_strategy(subject, [sphere()], [LOSSLESS[name]], [WHITE_SKY], view, 1.0, name, 2, strategies, 100)


@SECTION.case(
    "energy",
    "A surface reflects and transmits the shares given by its weights, and never more than it receives.",
    EXACT,
    "Veach 1997, 4.5 and 5.3",
)
def energy(subject: Subject) -> Iterator[Measurement]:
    """Under a white environment with a black plane behind the surface (R), then without it (R + T / eta^2)."""
    for name, surface in ABSORBING.items():
        for below in (False, True):
            eta = 1 / surface.ior if below else surface.ior
            bed = Plane((0.0, 1.0 if below else -1.0, 0.0), (0.0, 1.0, 0.0), 1)
            errors = []
            for degrees in ANGLES:
                view = toward(degrees, below)
                sides: list[list[Shape]] = [[FLOOR, bed], [FLOOR]]
                black, both = (subject.radiance(side, [surface, material()], [WHITE_SKY], view, whitted(2)) for side in sides)
                reflected, transmitted = _weights(surface, eta, cosine_of(view))
                sent = black + (both - black) * eta**2
                errors += [black - reflected, (both - black) * eta**2 - transmitted, max(sent - 1, 0.0)]
            yield measurement(errors, f"{name}, from {'behind' if below else 'the front'}")


def _weights(surface: Material, eta: float, cosine: float) -> tuple[float, float]:
    """(reflected, transmitted) shares of the light. Without Fresnel, total reflection includes the weight of kt."""
    kd, ks, kt = surface.kd[0], surface.ks[0], surface.kt[0]
    if surface.fresnel:
        share = fresnel(0.0, eta, cosine)
        return kd + ks * share, kt * (1 - share)
    total = (1 - cosine**2) / eta**2 >= 1
    return (kd + ks + kt, 0.0) if total else (kd + ks, kt)


@SECTION.case(
    "metal", "A smooth metal reflects by Fresnel's equations, a rough one by GGX microfacets.", EXACT, "Walter et al. 2007"
)
def metals(subject: Subject) -> Iterator[Measurement]:
    eta, k = 0.4, 2.4
    smooth, rough = (_metal(eta, k, alpha) for alpha in (0.0, 0.4))
    errors = []
    for degrees in ANGLES:
        view = toward(degrees, False)
        truth = forms.conductor(eta, k, cosine_of(view))
        shaders = whitted(2), path_tracer(2)
        errors += [subject.radiance([FLOOR], [smooth], [WHITE_SKY], view, shader) - truth for shader in shaders]
    yield measurement(errors, "smooth")
    errors = []
    for light, eye in (((30, 10), (30, 190)), ((60, 200), (20, 50)), ((10, 0), (70, 100))):
        wi, wo = direction(*light), direction(*eye)
        cosine = float(wi @ (wi + wo) / np.linalg.norm(wi + wo))
        truth = forms.conductor(eta, k, cosine) * forms.specular_value(0.4, wo, wi)
        errors.append(_scattered(subject, rough, wi, wo) * wi[1] - truth)
    yield measurement(errors, "rough")


def _metal(eta: float, k: float, alpha: float) -> Material:
    return material(bsdf=Conductor(grey(eta), grey(k), alpha=(alpha, alpha)))


@SECTION.case("recip", "BSDFs are reciprocal: f(wi, wo) = f(wo, wi).", EXACT, "Veach 1997, 5.2")
def reciprocity(subject: Subject) -> Iterator[Measurement]:
    """Renders a directional light from wi with the camera at wo, then with the two exchanged."""
    directions = [direction(*angles) for angles in ((0, 0), (30, 10), (60, 200), (80, 100))]
    for name in ("matte", "mixed", "frosted"):
        errors = []
        for a, b in ((a, b) for a in directions for b in directions if a is not b):
            there, back = (_scattered(subject, ABSORBING[name], i, o) for i, o in ((a, b), (b, a)))
            errors += [there - back, there - ABSORBING[name].kd[0] / math.pi]
        yield measurement(errors, name)


def _scattered(subject: Subject, surface: Material, light: np.ndarray, eye: np.ndarray) -> float:
    x, y, z = (float(value) for value in -light)
    view = point_view(4 * eye, ORIGIN, up=(0.3, 0.2, 0.9))
    sun = DirectionalLight((x, y, z), grey(1))
    return subject.radiance([FLOOR], [surface], [sun], view, path_tracer(2)) / -y


@SECTION.case(
    "recip.glass", "Transmission is reciprocal: L / n^2 is the same in both directions (Stokes).", EXACT, "Stokes 1849"
)
def stokes(subject: Subject) -> Iterator[Measurement]:
    """A light below seen from above, and one above seen from below, at angles that correspond by Snell's law."""
    for name in ("glass", "diamond", "pane"):
        surface = ABSORBING[name]
        errors = []
        # not closer to 90: there n^2 tan magnifies the rounding of the inner ray in float32 beyond what is allowed
        for degrees in (0, 15, 40, 65, 85):
            inner = math.degrees(math.asin(math.sin(math.radians(degrees)) / surface.ior))
            seen = []
            for angle, below in ((degrees, False), (inner, True)):
                emitter = Plane((0.0, 1.0 if below else -1.0, 0.0), (0.0, -1.0 if below else 1.0, 0.0), 1)
                view = toward(angle, below, distance=0.5)
                seen.append(subject.radiance([FLOOR, emitter], [surface, material(emission=1)], [], view, whitted(2)))
            errors.append(seen[0] * surface.ior**2 - seen[1] / surface.ior**2)
        yield measurement(errors, name)
