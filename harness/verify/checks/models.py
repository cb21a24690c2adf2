"""BSDF models and what wraps them, as images show them, against closed forms and quadrature.

A row of panels holds every model, so that an engine compiles its code once. Where an engine refuses the row, each panel
stands alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from engines.scene import (
    Blend,
    Bsdf,
    Bump,
    Checkerboard,
    Conductor,
    Dielectric,
    Diffuse,
    DirectionalLight,
    EnvironmentLight,
    ImageTexture,
    Light,
    Mask,
    Mesh,
    NormalMap,
    Null,
    Plastic,
    Principled,
    Sheen,
    Sides,
    ThinDielectric,
)
from harness.verify import scattering
from harness.verify.case import Array, Measurement, Section, measurement
from harness.verify.replicates import STRATEGIES, z_score
from harness.verify.scenes import direction, grey, material, path_tracer, point_view, scene
from harness.verify.subject import Skipped, Subject
from harness.verify.tolerances import EXACT, Tolerance, Z

SECTION = Section("models")
CLOSED_FORM = Tolerance("absolute", 1e-10, 1e-4)
RAMP = (0.5, 0.0, 0.25, 0.0, 0.5, 0.25)
"""`to_uv` by which a bilinear image of 2 x 2 texels is linear in (u, v) on [0, 1]."""
WHITE = EnvironmentLight((1.0, 1.0, 1.0), np.ones((4, 8, 3)))


def ramp(along_u: float, along_v: float) -> ImageTexture:
    """The height `along_u` u + `along_v` v, for (u, v) in [0, 1]."""
    corners = np.array([[0.0, along_u], [along_v, along_u + along_v]], np.float32)
    return ImageTexture(corners[:, :, None], wrap="clamp", to_uv=RAMP)


MODELS: dict[str, Bsdf] = {
    "diffuse": Diffuse(grey(0.7)),
    "GGX conductor": Conductor(grey(0.4), grey(2.4), (0.4, 0.4)),
    "anisotropic Beckmann conductor": Conductor(grey(0.4), grey(2.4), (0.5, 0.25), grey(0.9), "beckmann"),
    "GGX dielectric": Dielectric(1.5, (0.4, 0.4)),
    "anisotropic Beckmann dielectric": Dielectric(1.33, (0.3, 0.5), grey(0.9), grey(0.8), "beckmann"),
    "smooth plastic": Plastic(grey(0.6), 1.49),
    "nonlinear plastic": Plastic(grey(0.6), 1.6, nonlinear=True),
    "rough plastic": Plastic(grey(0.5), 1.5, 0.3),
    "principled base": Principled(grey(0.6), 0.7, eta=1.4, flatness=0.4, sheen=0.5, spec_tint=0.3),
    "principled coat": Principled(grey(0.5), 0.6, 0.5, 0.4, clearcoat=1.0, clearcoat_gloss=0.1),
    "principled glass": Principled(grey(0.8), 0.6, eta=1.5, metallic=0.2, spec_trans=0.7),
    "sheen": Sheen(grey(0.8)),
}
MATT, BLACK = Diffuse(grey(1)), Diffuse(grey(0))
NORMAL, STEEP = (0.65, 0.4, 0.9), (0.3, 0.8, 0.85)
WRAPPED: dict[str, Bsdf] = {
    "mask": Mask(0.3, MATT),
    "masks in masks": Mask(0.5, Mask(0.5, MATT)),
    "blend": Blend(0.3, BLACK, MATT),
    "mask of a blend": Mask(0.6, Blend(0.75, Null(), MATT)),
    "bump of constant height": Bump(ImageTexture(np.full((2, 2, 1), 0.7, np.float32)), 3.0, MATT),
    "sloping bump": Bump(ramp(0.5, -0.25), 0.8, MATT),
    "flat normal map": NormalMap(Checkerboard((0.5, 0.5, 1.0), (0.5, 0.5, 1.0)), MATT),
    "normal map": NormalMap(Checkerboard(NORMAL, NORMAL), MATT),
    "bump on a normal map": NormalMap(Checkerboard(STEEP, STEEP), Bump(ramp(0.0, 0.0), 1.0, MATT)),
    "sides": Sides(MATT, None),
    "pane": ThinDielectric(1.5, grey(0.9), grey(0.8)),
    "clear glass": Dielectric(1.5),
}
ALL: dict[str, Bsdf] = {**MODELS, **WRAPPED}


def panel(x: float, index: int) -> Mesh:
    """A square of side 1 that faces up, at x; its u runs along x, its v along -z."""
    corners = np.array([(x, 0, 1), (x + 1, 0, 1), (x + 1, 0, 0), (x, 0, 0)], np.float64)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64)
    return Mesh(corners, faces, np.full(2, index, np.int32), uvs=uvs)


def _image(
    subject: Subject, name: str, wo: Array, lights: list[Light], shader: Any, side: int = 1, spp: int = 1, **settings: Any
) -> Array:
    """The panel of this material as it is seen from wo, in world axes."""
    names = list(ALL)
    for row in (names, [name]):
        place = row.index(name)
        point = np.array([1.5 * place + 0.4, 0.0, 0.3])
        view = point_view(point + 3 * wo, point, side, up=(0.3, 0.2, 0.9))
        panels = [panel(1.5 * i, i) for i in range(len(row))]
        materials = [material(bsdf=ALL[each]) for each in row]
        try:
            film = subject.renderer(scene(panels, materials, lights, view), shader=shader, **settings).render(spp)
        except Skipped:
            if row is names:
                continue
            raise
        return np.full((side, side), np.inf) if film.bad_samples else film.mean()[:, :, 0]
    raise AssertionError


def _accepted(subject: Subject, names: Mapping[str, Any], lights: list[Light]) -> Iterator[str]:
    """Those of the materials that the engine has. Raises `Skipped` where it has none."""
    reasons, accepted = [], 0
    for name in names:
        try:
            _image(subject, name, direction(10, 0), lights, path_tracer(2), 1, sampler="constant")
        except Skipped as reason:
            reasons.append(reason)
            continue
        accepted += 1
        yield name
    if not accepted:
        raise reasons[0]


def to_local(v: Array, front: bool) -> Array:
    """World to the frame of a panel: x along its u, z towards the viewer."""
    side = 1.0 if front else -1.0
    return np.stack([v[0], -side * v[2], side * v[1]])


def _sun(wi: Array) -> list[Light]:
    x, y, z = (float(c) for c in -wi)
    return [DirectionalLight((x, y, z), grey(1))]


VIEWS = ((0, 0), (35, 20), (60, 200), (120, 300))
SUNS = ((5, 90), (40, 160), (65, 10), (140, 60), (160, 250))


@SECTION.case(
    "mod",
    "Every model scatters a directional light as its closed form has it, on both sides.",
    CLOSED_FORM,
    "Walter et al. 2007, Burley 2015",
)
def values(subject: Subject) -> Iterator[Measurement]:
    for name in _accepted(subject, MODELS, _sun(direction(0, 0))):
        errors = []
        for view in VIEWS:
            wo, front = direction(*view), view[0] < 90
            for sun in SUNS:
                wi = direction(*sun)
                seen = _image(subject, name, wo, _sun(wi), path_tracer(2), 1, sampler="constant")[0, 0]
                truth = scattering.value(MODELS[name], to_local(wo, front), to_local(wi, front)[:, None], front)[0]
                errors.append(seen - truth)
        yield measurement(errors, name)


@SECTION.case(
    "mod.recip", "Opaque models are reciprocal, and rough glass is but for the squared index.", CLOSED_FORM, "Veach 1997, 5.2"
)
def reciprocity(subject: Subject) -> Iterator[Measurement]:
    pairs = (((35, 20), (60, 200)), ((10, 0), (70, 130)))
    through = ((30, 20), (155, 220))
    for name in _accepted(subject, MODELS, _sun(direction(0, 0))):
        leaf: Any = MODELS[name]
        glass = isinstance(leaf, Dielectric)
        errors = []
        for a, b in (*pairs, through) if glass else pairs:
            i, o = direction(*a), direction(*b)
            there, back = (
                _image(subject, name, y, _sun(x), path_tracer(2), 1, sampler="constant")[0, 0] / abs(x[1])
                for x, y in ((i, o), (o, i))
            )
            errors.append(there - back * (leaf.ior**2 if glass and b[0] > 90 else 1.0))
        yield measurement(errors, name)


class Sky(NamedTuple):
    """A sky of 8 x 16 texels, its pixels, and quadrature over all directions: (3, n) in world axes, radiance, weight."""

    light: EnvironmentLight
    directions: Array
    radiance: Array
    weight: Array


def uneven_sky() -> Sky:
    """Radiance from 0 to 2, no symmetry; interpolated between texels."""
    texels = np.random.default_rng(17).random((8, 16)) * 2
    light = EnvironmentLight((1.0, 1.0, 1.0), np.repeat(texels[:, :, None], 3, axis=2))
    nodes, weights = np.polynomial.legendre.leggauss(400)
    turns = (np.arange(600) + 0.5) / 600
    y, u = (each.ravel() for each in np.meshgrid(nodes, turns, indexing="ij"))
    ring, phi = np.sqrt(1 - y * y), 2 * math.pi * u
    around = np.stack([ring * np.sin(phi), y, -ring * np.cos(phi)])
    return Sky(light, around, looked_up(texels, around), np.repeat(weights, 600) * 2 * math.pi / 600)


def looked_up(texels: Array, d: Array, poles: bool = False) -> Array:
    """(n,) values of a latitude-longitude image in directions (3, n), bilinear: columns wrap, rows clamp."""
    height, width = texels.shape
    x = np.arctan2(d[0], -d[2]) / (2 * math.pi) % 1.0 * width - 0.5
    v = np.arccos(np.clip(d[1], -1, 1)) / math.pi
    y = v * (height - 1) if poles else np.clip(v * height - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), height - 2)
    fx, fy = x - left, y - top
    rows = [(1 - fx) * texels[top + k, left % width] + fx * texels[top + k, (left + 1) % width] for k in (0, 1)]
    return (1 - fy) * rows[0] + fy * rows[1]


@SECTION.case("mod.sky", "Under an uneven sky every strategy has the mean that quadrature of the closed form gives.", Z)
def under_sky(subject: Subject) -> Iterator[Measurement]:
    """Wrong densities, weights or samples of a model change the mean of `bsdf` or of `mis`."""
    sky = uneven_sky()
    for name in _accepted(subject, MODELS, [sky.light]):
        leaf: Any = MODELS[name]
        for polar in subject.subset((25, 130) if isinstance(leaf, Dielectric) else (25, 70), 1):
            wo, front = direction(polar, 30), polar < 90
            local, towards = to_local(wo, front), to_local(sky.directions, front)
            truth = float((scattering.value(leaf, local, towards, front) * sky.radiance * sky.weight).sum())
            if isinstance(leaf, Plastic) and not leaf.alpha:
                mirror = np.array([[-wo[0]], [wo[1]], [-wo[2]]])
                truth += float(scattering.fresnel(local[2], leaf.ior)) * looked_up(sky.light.image[:, :, 0], mirror)[0]  # type: ignore[index]
            transmits = isinstance(leaf, Dielectric) or leaf is MODELS["principled glass"]  # `light` alone is all noise there
            for direct in STRATEGIES[1:] if transmits or subject.quick else STRATEGIES:
                seen = _image(subject, name, wo, [sky.light], path_tracer(2, direct), 32, 8 if subject.quick else 16)
                yield z_score(subject, seen.ravel(), truth, f"{name}, {polar} degrees, {direct}", 2e-2)


@SECTION.case("mod.white", "In a white surrounding matt masks, blends, bumps and lossless models have their share.", Z)
def white(subject: Subject) -> Iterator[Measurement]:
    """A mask lets pass what it does not hold; a blend has the mean of its parts."""
    shares = {
        "mask": 1.0,
        "masks in masks": 1.0,
        "blend": 0.3,
        "mask of a blend": 1.0,
        "bump of constant height": 1.0,
        "sides": 1.0,
        "clear glass": 0.0,
        "pane": 0.0,
    }
    for name in _accepted(subject, shares, [WHITE]):
        wo = direction(40, 30)
        once = float(scattering.fresnel(wo[1], 1.5))
        slab = 2 * once / (1 + once)
        share = {"clear glass": once + (1 - once) / 1.5**2, "pane": 0.9 * slab + 0.8 * (1 - slab)}.get(name, shares[name])
        seen = _image(subject, name, wo, [WHITE], path_tracer(3, "bsdf"), 32, 16)
        yield z_score(subject, seen.ravel(), share, name, 2e-2)


@SECTION.case("mod.mask", "A mask over a black sky sends through what its opacity leaves, and hides the rest.", Z)
def masks(subject: Subject) -> Iterator[Measurement]:
    """The sky is white below the horizon, and black above: what arrives has passed."""
    below = np.concatenate([np.zeros((4, 8, 3)), np.ones((4, 8, 3))])
    sky: list[Light] = [EnvironmentLight((1.0, 1.0, 1.0), below)]
    for name, share in (("mask", 0.7), ("masks in masks", 0.75), ("mask of a blend", 0.4 + 0.6 * 0.25), ("pane", None)):
        wo = direction(30, 75)
        once = float(scattering.fresnel(wo[1], 1.5))
        truth = share if share is not None else 0.8 * (1 - 2 * once / (1 + once))
        for direct in ("bsdf", "mis"):
            seen = _image(subject, name, wo, sky, path_tracer(2, direct), 32, 16)
            held = {"mask": 0.3, "masks in masks": 0.25, "mask of a blend": 0.45}.get(name, 0.0)
            yield z_score(subject, seen.ravel(), truth + held * _leak(), f"{name}, {direct}", 2e-2)


def _leak() -> float:
    """What a matt floor shows of the sky of `masks`: the radiance falls to 0 from 11.25 degrees below to as many above."""
    edge = math.radians(11.25)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    height = (nodes + 1) / 2 * edge
    radiance = 0.5 * (1 - height / edge)
    return float((radiance * np.sin(height) * 2 * np.cos(height) * weights).sum() * edge / 2)


@SECTION.case(
    "mod.tilt",
    "Bumps and normal maps turn the normal: Lambert's cosine, shadowed by the tilt.",
    Tolerance("absolute", 1e-10, 1e-5),
    "Estevez, Lecocq and Stein 2019",
)
def tilts(subject: Subject) -> Iterator[Measurement]:
    """A bump of constant height and a flat map change nothing. From behind, maps keep their y and bumps rise to the viewer."""

    def normal(texel: tuple[float, ...]) -> Array:
        return scattering.unit(2 * np.array(texel) - 1)

    tilted = {
        "bump of constant height": np.array([0.0, 0.0, 1.0]),
        "flat normal map": np.array([0.0, 0.0, 1.0]),
        "sloping bump": scattering.unit(np.array([-0.4, 0.2, 1.0])),
        "normal map": normal(NORMAL),
        "bump on a normal map": normal(STEEP),
    }
    for name in _accepted(subject, tilted, _sun(direction(0, 0))):
        errors = []
        for view in ((10, 0), (25, 220), (160, 40)):
            front = view[0] < 90
            turned = tilted[name] * np.array([1.0, 1.0 if front else -1.0, 1.0])
            for sun in ((5, 90), (30, 160), (50, 300), (150, 60), (165, 250)):
                wo, wi = direction(*view), direction(*sun)
                local = to_local(wi, front)
                cosine, lit = float(turned @ local), float(local[2]) > 0
                spread = (1 - turned[2] ** 2) / turned[2] ** 2
                tangent2 = (1 - local[2] ** 2) / local[2] ** 2
                shadow = 2 / (1 + math.sqrt(1 + min(spread / 8, 1.0) * tangent2))
                truth = max(cosine, 0.0) / math.pi * shadow if lit else 0.0
                seen = _image(subject, name, wo, _sun(wi), path_tracer(2), 1, sampler="constant")[0, 0]
                errors.append(seen - truth)
        yield measurement(errors, name)


@SECTION.case("mod.sides", "A material of the front alone is black from behind.", EXACT)
def one_sided(subject: Subject) -> Iterator[Measurement]:
    errors = []
    for polar, share in ((20, 1.0), (70, 1.0), (110, 0.0), (170, 0.0)):
        seen = _image(subject, "sides", direction(polar, 10), [WHITE], path_tracer(2, "bsdf"), 1, sampler="constant")
        errors.append(seen[0, 0] - share)
    yield measurement(errors, "white in front")
