"""Bump and normal maps of the engine numpy against Mitsuba's `bumpmap` and `normalmap`: value, density and samples.

Mitsuba computes in float32; its `wi` is our `wo`, and its values have the cosine to the tilted normal in them.
"""

import numpy as np
import pytest

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.vectors import dot
from engines.peers.mitsuba.bsdfs import bsdf_node
from engines.peers.mitsuba.nodes import Placing
from engines.peers.mitsuba.stage import _with_transforms
from engines.peers.mitsuba.textures import Textures
from engines.scene import Blend, Bump, Conductor, Dielectric, ImageTexture, Material, Mixture, NormalMap
from tests.mitsuba.peer import mi
from tests.needs import needs

pytestmark = needs("mitsuba-scalar")

PAIRS = 400
DP_DU, DP_DV = (2.0, 0.0, 0.0), (0.4, 1.5, 0.0)
METAL = Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), (0.3, 0.3))
MIRROR = Conductor(METAL.eta, METAL.k)
GLASS = Dielectric(1.5, (0.4, 0.4))
GREY = Mixture((0.5, 0.6, 0.7))


def image(rng, channels):
    return ImageTexture(rng.random((6, 5, channels)).astype(np.float32))


def steep(rng):
    """Normals up to 60 degrees from the surface's, so that viewers are met from behind."""
    tilt, turn = rng.uniform(0.0, np.pi / 3.0, (6, 5)), rng.uniform(0.0, 2.0 * np.pi, (6, 5))
    normal = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=2)
    return ImageTexture((0.5 * normal + 0.5).astype(np.float32), filter="nearest")


def theirs(bsdf):
    if isinstance(bsdf, Mixture):
        return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(bsdf.kd)}}
    if isinstance(bsdf, Dielectric):
        indices = {"int_ior": bsdf.ior, "ext_ior": 1.0}
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": bsdf.alpha[0], **indices}
    if isinstance(bsdf, Conductor):
        eta, k = ({"type": "rgb", "value": list(index)} for index in (bsdf.eta, bsdf.k))
        rough = {"type": "roughconductor", "distribution": "ggx", "alpha": bsdf.alpha[0]}
        return {**(rough if max(bsdf.alpha) > 0.0 else {"type": "conductor"}), "eta": eta, "k": k}
    texture = bsdf.height if isinstance(bsdf, Bump) else bsdf.map
    data = {"type": "bitmap", "raw": True, "filter_type": texture.filter, "data": mi.TensorXf(texture.pixels)}
    if isinstance(bsdf, Bump):
        return {"type": "bumpmap", "height": data, "scale": bsdf.scale, "of": theirs(bsdf.of)}
    return {"type": "normalmap", "normalmap": data, "of": theirs(bsdf.of)}


def described(bsdf):
    """As the engine mitsuba writes it."""
    images = Placing(lambda *mesh: "", lambda name, image: {"bitmap": mi.Bitmap(np.ascontiguousarray(image, np.float32))})
    textures = Textures(images)
    node = bsdf_node(bsdf, textures)
    scene = {"type": "scene", **textures.nodes, "it": {"type": "sphere", "bsdf": node}}
    return mi.load_dict(_with_transforms(mi, scene)).shapes()[0].bsdf()


def point(uv, wo):
    si = mi.SurfaceInteraction3f()
    si.uv, si.n, si.wi = [float(x) for x in uv], [0.0, 0.0, 1.0], [float(x) for x in wo]
    si.sh_frame = mi.Frame3f([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    si.dp_du, si.dp_dv = list(DP_DU), list(DP_DV)
    return si


def points(uv, wo):
    """Met from the front or from behind, as the first of the directions says."""
    n, front = wo.shape[1], wo[2, 0] > 0.0
    up, du, dv = (np.repeat(np.reshape(v, (3, 1)), n, axis=1) for v in ((0.0, 0.0, 1.0 if front else -1.0), DP_DU, DP_DV))
    none = np.zeros(n, np.int64)
    return SurfaceInteraction(np.zeros((3, n)), wo, up, up, du, np.full(n, front), none, none, np.zeros(n), uv, dv)


def hemisphere(rng, n):
    z, phi = rng.uniform(0.05, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(phi), ring * np.sin(phi), z])


def above(rng):
    """A smooth map of normals of any length that point to the front."""
    return ImageTexture((rng.random((6, 5, 3)) * [1.0, 1.0, 0.5] + [0.0, 0.0, 0.5]).astype(np.float32))


def made(name, leaf):
    rng = np.random.default_rng(7)
    return {
        "bump": lambda: Bump(image(rng, 1), 1.5, leaf),
        "bump of a colour image": lambda: Bump(image(rng, 3), 3.0, leaf),
        "steep normal map": lambda: NormalMap(steep(rng), leaf),
        "smooth normal map": lambda: NormalMap(above(rng), leaf),
        "normals of all directions": lambda: NormalMap(image(rng, 3), leaf),
    }[name]()


MAPS = ["bump", "bump of a colour image", "steep normal map", "smooth normal map"]
"""Their normals point outwards."""
each_map = pytest.mark.parametrize("name", MAPS)


def densities(ours, bsdf, rng, directions, rtol, atol):
    """Mitsuba's densities, after its values and densities have been found to be ours."""
    uv, wo, wi = directions
    at, _ = ours.walk(points(uv, wo), rng.random(PAIRS))
    value, pdf = ours.evaluate(at, wi) * np.abs(dot(at.normal, wi)), ours.pdf(at, wi)
    expected = np.empty((4, PAIRS))
    for pair in range(PAIRS):
        si = point(uv[:, pair], wo[:, pair])
        colour, density = bsdf.eval_pdf(mi.BSDFContext(), si, [float(c) for c in wi[:, pair]])
        expected[:, pair] = *colour, density
    assert np.allclose(value, expected[:3], rtol=rtol, atol=atol)
    assert np.allclose(pdf, expected[3], rtol=rtol, atol=atol)
    return expected[3]


@pytest.mark.parametrize("name", [*MAPS, "normals of all directions"])
@pytest.mark.parametrize("leaf", [GREY, METAL], ids=["diffuse", "metal"])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["front", "back"])
def test_value_and_density_are_those_of_mitsuba(name, leaf, side):
    mi.set_variant("scalar_rgb")
    wrapper, rng = made(name, leaf), np.random.default_rng(3)
    ours, bsdf = Materials([Material("m", bsdf=wrapper)]), mi.load_dict({"type": "twosided", "of": theirs(wrapper)})
    uv, wo, wi = rng.random((2, PAIRS)), hemisphere(rng, PAIRS), hemisphere(rng, PAIRS)
    wo[2], wi[2] = side * wo[2], side * wi[2]
    expected = densities(ours, bsdf, rng, (uv, wo, wi), 2e-4, 1e-6)
    assert 0.02 < (expected == 0.0).mean() < 0.6  # some directions are none


@each_map
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["front", "back"])
def test_light_that_passes_a_tilted_rough_interface_is_mitsubas(name, side):
    """Reflection and refraction; directions that only one of the two normals has on the far side are none. From behind, the
    front is tilted: there is no `twosided` around what transmits."""
    mi.set_variant("scalar_rgb")
    wrapper, rng = made(name, GLASS), np.random.default_rng(5)
    ours, bsdf = Materials([Material("m", bsdf=wrapper)]), mi.load_dict(theirs(wrapper))
    uv, wo, wi = rng.random((2, PAIRS)), hemisphere(rng, PAIRS), hemisphere(rng, PAIRS)
    wi[2] *= np.where(np.arange(PAIRS) % 3 == 0, side, -side)
    wo[2] *= side
    expected = densities(ours, bsdf, rng, (uv, wo, wi), 1e-3, 1e-5)
    assert (expected[side * wi[2] < 0.0] > 0.0).mean() > 0.1


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["front", "back"])
def test_what_is_opaque_beside_tilted_glass_has_the_tilt_of_the_glass(side):
    """As the engine mitsuba describes it: the opaque model is two-sided inside of the map."""
    mi.set_variant("scalar_rgb")
    rng, share = np.random.default_rng(11), 0.3
    wrapper = NormalMap(steep(rng), Blend(share, GLASS, METAL))
    bsdf = described(wrapper)
    ours = Materials([Material("m", bsdf=wrapper)])
    uv, wo, wi = rng.random((2, PAIRS)), hemisphere(rng, PAIRS), hemisphere(rng, PAIRS)
    wo[2], wi[2] = side * wo[2], np.where(np.arange(PAIRS) % 3 == 0, -side, side) * wi[2]
    value = 0.0
    for weight, u in ((share, 0.0), (1.0 - share, 1.0)):
        at, _ = ours.walk(points(uv, wo), np.full(PAIRS, u))
        value = value + weight * ours.evaluate(at, wi) * np.abs(dot(at.normal, wi))
    expected = np.empty((3, PAIRS))
    for pair in range(PAIRS):
        si = point(uv[:, pair], wo[:, pair])
        expected[:, pair] = bsdf.eval(mi.BSDFContext(), si, [float(c) for c in wi[:, pair]])
    assert np.allclose(value, expected, rtol=1e-3, atol=1e-5)


@each_map
def test_a_tilted_mirror_shows_what_mitsubas_shows(name):
    mi.set_variant("scalar_rgb")
    wrapper, rng = made(name, MIRROR), np.random.default_rng(4)
    ours, bsdf = Materials([Material("m", bsdf=wrapper)]), mi.load_dict(theirs(wrapper))
    uv, wo = rng.random((2, PAIRS)), hemisphere(rng, PAIRS)
    at, uc = ours.walk(points(uv, wo), rng.random(PAIRS))
    found, shown = ours.sample(at, uc, uc, uc), 0
    for ray in range(PAIRS):
        sample, weight = bsdf.sample(mi.BSDFContext(), point(uv[:, ray], wo[:, ray]), 0.5, [0.5, 0.5])
        assert np.allclose(found.weight[:, ray], np.ravel(weight), rtol=2e-4, atol=1e-6)
        if found.weight[0, ray] > 0.0:
            assert np.allclose(found.wi[:, ray], np.ravel(sample.wo), atol=1e-5)
            shown += 1
    assert 0.3 * PAIRS < shown < PAIRS
