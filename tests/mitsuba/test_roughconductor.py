"""The conductor of the engine numpy against Mitsuba's `conductor` and `roughconductor`: value, density and reflectance.

Mitsuba computes in float32, so that roughnesses start at 0.02; its `wi` is our `wo`, and its values have the cosine in them.
"""

import numpy as np
import pytest

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.scene import Conductor, Material
from engines.scene.metals import METALS

mi = pytest.importorskip("mitsuba", reason="the extra is not installed: pip install 'raybench[mitsuba]'")

PAIRS = 1000
WHITE = (1.0, 1.0, 1.0)
PARAMETERS = [
    Conductor(*METALS["Au"], (0.1, 0.1)),
    Conductor(*METALS["Ag"], (0.02, 0.02)),
    Conductor(*METALS["Al"], (0.05, 0.3)),
    Conductor(*METALS["Al"], (0.3, 0.05), (0.9, 0.5, 0.1)),
    Conductor(*METALS["Cu"], (0.5, 0.5)),
    Conductor(*METALS["Cr"], (1.0, 1.0)),
    Conductor(*METALS["W"], (0.02, 1.0)),
    Conductor(*METALS["Hg"], (0.2, 0.25), (0.3, 1.0, 0.0)),
    Conductor((0.0, 0.0, 0.0), WHITE, (0.4, 0.7)),
    Conductor((1.5, 2.0, 0.7), (0.0, 0.1, 0.5), (0.15, 0.15)),
]


def theirs(conductor):
    rough = max(conductor.alpha) > 0.0
    kind = {
        "type": "roughconductor",
        "distribution": "ggx",
        "alpha_u": conductor.alpha[0],
        "alpha_v": conductor.alpha[1],
    }
    colours = {"eta": conductor.eta, "k": conductor.k, "specular_reflectance": conductor.reflectance}
    colours = {name: {"type": "rgb", "value": [float(c) for c in value]} for name, value in colours.items()}
    return mi.load_dict({**(kind if rough else {"type": "conductor"}), **colours})


def frames(wo):
    """Points seen from `wo` (3, n), with the frame of the world's axes."""
    n = wo.shape[1]
    x, z = (np.repeat(np.eye(3)[:, [axis]], n, axis=1) for axis in (0, 2))
    none = np.zeros(n, np.int64)
    return SurfaceInteraction(np.zeros((3, n)), wo, z, z, x, none == 0, none, none, np.zeros(n))


def hemisphere(rng, n):
    z, phi = rng.uniform(0.02, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(phi), ring * np.sin(phi), z])


@pytest.mark.parametrize("number", range(len(PARAMETERS)))
def test_value_and_density_are_those_of_mitsuba(number):
    """To 1e-4, at 1,000 pairs of directions: half are even, and half lie where the lobe is."""
    mi.set_variant("scalar_rgb")
    rng, conductor = np.random.default_rng(number), PARAMETERS[number]
    ours, bsdf, si, context = (
        Materials([Material("m", bsdf=conductor)]),
        theirs(conductor),
        mi.SurfaceInteraction3f(),
        mi.BSDFContext(),
    )
    wo, wi = hemisphere(rng, PAIRS), hemisphere(rng, PAIRS)
    found = ours.sample(frames(wo), *rng.random((3, PAIRS)))
    wi = np.where((np.arange(PAIRS) % 2 == 0) & (found.wi[2] > 0.02), found.wi, wi)
    value, pdf = ours.evaluate(frames(wo), wi) * wi[2], ours.pdf(frames(wo), wi)
    expected = np.empty((4, PAIRS))
    for pair in range(PAIRS):
        si.wi = [float(c) for c in wo[:, pair]]
        colour, density = bsdf.eval_pdf(context, si, [float(c) for c in wi[:, pair]])
        expected[:, pair] = *colour, density
    assert np.allclose(value, expected[:3], rtol=1e-4, atol=0.0) and np.allclose(pdf, expected[3], rtol=1e-4, atol=0.0)


@pytest.mark.parametrize("metal", METALS)
def test_a_smooth_conductor_reflects_as_mitsubas(metal):
    mi.set_variant("scalar_rgb")
    conductor = Conductor(*METALS[metal], reflectance=(1.0, 0.5, 0.25))
    wo, draws = hemisphere(np.random.default_rng(1), 50), np.zeros((3, 50))
    found = Materials([Material("m", bsdf=conductor)]).sample(frames(wo), *draws)
    bsdf, si = theirs(conductor), mi.SurfaceInteraction3f()
    for ray in range(50):
        si.wi = [float(c) for c in wo[:, ray]]
        sample, weight = bsdf.sample(mi.BSDFContext(), si, 0.5, [0.5, 0.5])
        assert np.allclose(found.wi[:, ray], np.ravel(sample.wo), atol=1e-6)
        assert np.allclose(found.weight[:, ray], np.ravel(weight), rtol=1e-5)
