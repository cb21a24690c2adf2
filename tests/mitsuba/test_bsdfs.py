"""The BSDF models of the engine numpy against Mitsuba's: value and density, and the samples of delta lobes.

Mitsuba computes in float32; its `wi` is our `wo`, and its values have the cosine in them.
"""

import numpy as np
import pytest

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.scene import Conductor, Dielectric, Diffuse, Material, Plastic, Principled, Sheen, ThinDielectric
from engines.scene.metals import METALS
from tests.bsdf_parameter_sets import AMBER, CONDUCTORS, DIELECTRICS, PRINCIPLED, ROUGH_PLASTICS, SHEENS, SMOOTH_PLASTICS, TEAL
from tests.mitsuba.peer import mi
from tests.needs import needs

pytestmark = needs("mitsuba-scalar")

PAIRS = 1000


def described(leaf):
    """Mitsuba's dictionary of a leaf."""

    def rgb(value):
        return {"type": "rgb", "value": [float(c) for c in value]}

    def rough(kind):
        one, two = leaf.alpha if isinstance(leaf.alpha, tuple) else (leaf.alpha, leaf.alpha)
        if one == 0.0:
            return {"type": kind}
        alpha = {"alpha": one} if kind == "plastic" else {"alpha_u": one, "alpha_v": two}
        return {"type": f"rough{kind}", "distribution": leaf.distribution, **alpha}

    match leaf:
        case Diffuse():
            return {"type": "diffuse", "reflectance": rgb(leaf.reflectance)}
        case Conductor():
            scale = {"specular_reflectance": rgb(leaf.reflectance)}
            return {**rough("conductor"), "eta": rgb(leaf.eta), "k": rgb(leaf.k), **scale}
        case Dielectric() | ThinDielectric():
            kind = {"type": "thindielectric"} if isinstance(leaf, ThinDielectric) else rough("dielectric")
            scales = {"specular_reflectance": rgb(leaf.reflectance), "specular_transmittance": rgb(leaf.transmittance)}
            return {**kind, "int_ior": leaf.ior, "ext_ior": 1.0, **scales}
        case Plastic():
            scales = {"specular_reflectance": rgb(leaf.reflectance), "diffuse_reflectance": rgb(leaf.diffuse)}
            return {**rough("plastic"), "int_ior": leaf.ior, "ext_ior": 1.0, "nonlinear": leaf.nonlinear, **scales}
        case Principled():
            names = (
                "roughness",
                "anisotropic",
                "metallic",
                "eta",
                "spec_tint",
                "sheen",
                "sheen_tint",
                "clearcoat",
                "clearcoat_gloss",
                "flatness",
                "spec_trans",
            )
            numbers = {name: getattr(leaf, name) for name in names}
            return {"type": "principled", "base_color": rgb(leaf.base_color), **numbers}
        case Sheen():
            return {"type": "principled", "base_color": rgb((0.0, 0.0, 0.0)), "eta": 1.0, "sheen": leaf.color[0]}
        case _:
            raise TypeError(leaf)


def frames(wo):
    """Points seen from `wo` (3, n), with the frame of the world's axes; from behind where wo.z < 0."""
    n = wo.shape[1]
    x, z = (np.repeat(np.eye(3)[:, [axis]], n, axis=1) for axis in (0, 2))
    z = np.where(wo[2] > 0.0, z, -z)
    none = np.zeros(n, np.int64)
    return SurfaceInteraction(np.zeros((3, n)), wo, z, z, x, wo[2] > 0.0, none, none, np.zeros(n))


def directions(rng, n, both_sides):
    """Even, away from the horizon."""
    z, phi = rng.uniform(0.02, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    ring = np.sqrt(1.0 - z * z)
    side = np.where(rng.random(n) < 0.5, -1.0, 1.0) if both_sides else 1.0
    return np.stack([ring * np.cos(phi), ring * np.sin(phi), side * z])


def compared(leaf, seed, least=1e-19):
    """Relative differences of value (3, n) and density (n,) at pairs of directions: half of them are even, and half lie
    where the lobes are. Transmitting leaves are seen from both sides. Differences below `least` are none."""
    mi.set_variant("scalar_rgb")
    both_sides = isinstance(leaf, Dielectric) or (isinstance(leaf, Principled) and leaf.spec_trans > 0.0)
    rng, ours, bsdf = np.random.default_rng(seed), Materials([Material("m", bsdf=leaf)]), mi.load_dict(described(leaf))
    si, context = mi.SurfaceInteraction3f(), mi.BSDFContext()
    wo, wi = directions(rng, PAIRS, both_sides), directions(rng, PAIRS, both_sides)
    at = frames(wo)
    found = ours.sample(at, *rng.random((3, PAIRS)))
    near = np.isfinite(found.pdf) & (np.abs(found.wi[2]) > 0.02) & (found.weight > 0.0).any(axis=0)
    wi = np.where((np.arange(PAIRS) % 2 == 0) & near, found.wi, wi)
    value, pdf = ours.evaluate(at, wi) * np.abs(wi[2]), ours.pdf(at, wi)
    expected = np.empty((4, PAIRS))
    for pair in range(PAIRS):
        si.wi = [float(c) for c in wo[:, pair]]
        colour, density = bsdf.eval_pdf(context, si, [float(c) for c in wi[:, pair]])
        expected[:, pair] = *colour, density
    clear = _clear(wo, wi, leaf) if both_sides else np.full(PAIRS, True)
    assert clear.mean() > 0.6
    return _differences(value, expected[:3], least)[:, clear], _differences(pdf, expected[3], least)[clear]


def _differences(found, expected, least):
    """Relative. Mitsuba takes a distribution of normals below 1e-20 for 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.abs(found - expected) < least, 0.0, np.abs(found - expected) / np.abs(expected))


def _clear(wo, wi, leaf):
    """(n,) whether facets that would refract `wi` meet both directions at more than 0.1 in cosine: nearer to their planes
    Mitsuba's cosines have too few digits."""
    eta = leaf.ior if isinstance(leaf, Dielectric) else getattr(leaf, "eta", 1.0)
    halfway = wo + np.where(wo[2] > 0.0, eta, 1.0 / eta) * wi
    halfway /= np.linalg.norm(halfway, axis=0)
    closest = np.minimum(np.abs((wo * halfway).sum(axis=0)), np.abs((wi * halfway).sum(axis=0)))
    return (wo[2] * wi[2] > 0.0) | (closest > 0.1)


def close(leaf, seed, value=1e-4, pdf=1e-4):
    differences = compared(leaf, seed)
    assert differences[0].max() < value and differences[1].max() < pdf


def by_number(leaves):
    return pytest.mark.parametrize(("number", "leaf"), list(enumerate(leaves)), ids=range(len(leaves)))


def of_beckmann(leaf):
    """The density of visible normals is exact here; Mitsuba's has the rational masking of the value."""
    return 4e-3 if leaf.distribution == "beckmann" else 1e-4


@by_number(CONDUCTORS)
def test_conductors_have_mitsubas_value_and_density(number, leaf):
    close(leaf, number, pdf=of_beckmann(leaf))


@by_number(DIELECTRICS)
def test_dielectrics_have_mitsubas_value_and_density(number, leaf):
    close(leaf, number, pdf=of_beckmann(leaf))


@by_number([*SMOOTH_PLASTICS, Diffuse(AMBER)])
def test_smooth_plastics_have_mitsubas_value_and_density(number, leaf):
    close(leaf, number)


@by_number(ROUGH_PLASTICS)
def test_rough_plastics_have_mitsubas_value_and_density(number, leaf):
    """To what the quadratures of two tables allow."""
    close(leaf, number, 1e-3, 8e-3)


@by_number(PRINCIPLED)
def test_principled_leaves_have_mitsubas_value_and_density(number, leaf):
    close(leaf, number)


@by_number([sheen for sheen in SHEENS if len(set(sheen.color)) == 1])
def test_grey_sheens_have_the_value_of_mitsubas_principled_of_nothing_else(number, leaf):
    """Its density is another: it samples the other lobes as well. In float32 1 - cos_d has few digits where it is small."""
    differences = compared(leaf, number, least=1e-12)
    assert differences[0].max() < 1e-4


@by_number(SHEENS)
def test_a_sheen_is_what_mitsubas_principled_gains_by_it(number, leaf):
    """In white and tinted: values with the sheen, less those without."""
    mi.set_variant("scalar_rgb")
    tint = max(leaf.color)
    base = dict(type="principled", base_color={"type": "rgb", "value": [float(c / tint) for c in leaf.color]}, roughness=0.8)
    with_sheen, without = (mi.load_dict({**base, "sheen": sheen, "sheen_tint": 1.0}) for sheen in (1.0, 0.0))
    luminance = sum(w * c / tint for w, c in zip((0.212671, 0.715160, 0.072169), leaf.color, strict=True))
    rng, si, context = np.random.default_rng(number), mi.SurfaceInteraction3f(), mi.BSDFContext()
    wo, wi = directions(rng, 200, False), directions(rng, 200, False)
    ours = Materials([Material("m", bsdf=leaf)]).evaluate(frames(wo), wi) * wi[2]
    for pair in range(200):
        si.wi, towards = [float(c) for c in wo[:, pair]], [float(c) for c in wi[:, pair]]
        gained = np.ravel(with_sheen.eval(context, si, towards)) - np.ravel(without.eval(context, si, towards))
        assert np.allclose(ours[:, pair], gained * luminance * tint, rtol=1e-3, atol=2e-6)


SMOOTH = {
    "gold": Conductor(*METALS["Au"], reflectance=(1.0, 0.5, 0.25)),
    "glass": Dielectric(1.5, (0.0, 0.0), AMBER, TEAL),
    "air in glass": Dielectric(0.7),
    "pane": ThinDielectric(1.5, AMBER, TEAL),
    "plastic": Plastic(AMBER, 1.6, nonlinear=True, reflectance=TEAL),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_delta_lobes_are_sampled_as_mitsubas(name):
    """With the same choice of the lobe, away from where it tips over."""
    mi.set_variant("scalar_rgb")
    leaf = SMOOTH[name]
    rng = np.random.default_rng(1)
    wo, draws = directions(rng, 100, isinstance(leaf, Dielectric)), rng.random((3, 100))
    found = Materials([Material("m", bsdf=leaf)]).sample(frames(wo), *draws)
    bsdf, si, same = mi.load_dict(described(leaf)), mi.SurfaceInteraction3f(), 0
    for ray in np.flatnonzero(np.isinf(found.pdf)):
        si.wi = [float(c) for c in wo[:, ray]]
        sample, weight = bsdf.sample(mi.BSDFContext(), si, float(draws[0, ray]), [0.5, 0.5])
        assert np.allclose(found.wi[:, ray], np.ravel(sample.wo), atol=1e-5)
        assert np.allclose(found.weight[:, ray], np.ravel(weight), rtol=1e-4)
        same += 1
    assert same > 5
