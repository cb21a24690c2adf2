"""Points of a surface, made by hand, and a BSDF asked for at them; directions are (3, n)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.vectors import cosine_hemisphere, dot
from engines.scene import Conductor, CustomBSDF, Dielectric, Diffuse, Material, Null, Plastic, Principled, Sheen, ThinDielectric
from tests.numpy_reference.small_scenes import material

UP = np.array([[0.0], [0.0], [1.0]])
EAST = np.array([[1.0], [0.0], [0.0]])
WHITE = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
"""eta and k of a conductor that reflects everything at every angle."""
GOLD = ((0.14304, 0.37531, 1.44205), (3.98300, 2.38556, 1.60336))


def conductor(alpha, index=WHITE, reflectance=(1.0, 1.0, 1.0)):
    alpha = alpha if isinstance(alpha, tuple) else (alpha, alpha)
    return Material("metal", bsdf=Conductor(*index, alpha, reflectance))


class LommelSeeliger:
    """Dust, as the moon's: f is in proportion to 1 / (cos_o + cos_i). A plugin, with samples by the cosine rule."""

    name = "lommel_seeliger"
    options = {"albedo": (0.5, 0.5, 0.5)}  # noqa: RUF012

    @property
    def numpy(self):
        return self

    def evaluate(self, options, at, wi):
        return np.reshape(options["albedo"], (3, 1)) / (4.0 * np.pi) / (dot(at.normal, at.wo) + dot(at.normal, wi))

    def pdf(self, options, at, wi):
        return dot(at.normal, wi) / np.pi

    def sample(self, options, at, uc, u0, u1, lobes):
        wi = cosine_hemisphere(at.normal, u0, u1)
        return wi, self.evaluate(options, at, wi) * np.pi, self.pdf(options, at, wi)

    def albedos(self, options):
        return options["albedo"], options["albedo"]


class Paper(LommelSeeliger):
    """A sheet that light passes as well as it is reflected: a plugin that transmits, half of its samples below."""

    name = "paper"
    transmission = True

    def evaluate(self, options, at, wi):
        return np.reshape(options["albedo"], (3, 1)) / (2.0 * np.pi) * np.ones(wi.shape[1])

    def pdf(self, options, at, wi):
        return np.abs(dot(at.normal, wi)) / (2.0 * np.pi)

    def sample(self, options, at, uc, u0, u1, lobes):
        wi = cosine_hemisphere(np.where(uc < 0.5, at.normal, -at.normal), u0, u1)
        return wi, np.reshape(options["albedo"], (3, 1)) * np.ones(uc.size), self.pdf(options, at, wi)


def of(leaf):
    """A material with this BSDF."""
    return Material(type(leaf).__name__, bsdf=leaf)


PAINT = Principled(
    (0.7, 0.3, 0.2),
    0.5,
    anisotropic=0.6,
    metallic=0.3,
    eta=1.6,
    spec_tint=0.4,
    sheen=0.5,
    sheen_tint=0.6,
    clearcoat=0.8,
    clearcoat_gloss=0.2,
    flatness=0.4,
)
JELLY = Principled((0.8, 0.9, 0.5), 0.6, metallic=0.1, eta=1.4, sheen=0.2, clearcoat=0.5, spec_trans=0.6)
FROSTED = Dielectric(1.5, (0.2, 0.4), (0.9, 0.8, 0.7), (0.5, 0.9, 0.8))
MODELS = {
    "kd": material(kd=0.6),
    "kd ks kt": material(kd=0.3, ks=0.4, kt=0.3, ior=1.5, fresnel=True),
    "diffuse": of(Diffuse((0.9, 0.5, 0.1))),
    "rough": conductor(0.5),
    "shiny": conductor(0.08, GOLD),
    "brushed": conductor((0.1, 0.45), GOLD, (0.9, 0.8, 0.7)),
    "worn": of(Conductor(*GOLD, (0.6, 0.4), distribution="beckmann")),
    "frosted": of(FROSTED),
    "frosted from inside": of(replace(FROSTED, alpha=(0.4, 0.6), distribution="beckmann")),
    "varnish": of(Plastic((0.9, 0.6, 0.3), 1.5, 0.0, True, (0.8, 0.9, 1.0))),
    "lacquer": of(Plastic((1.0, 1.0, 1.0), 1.7, 0.3)),
    "wax": of(Plastic((0.3, 0.6, 0.9), 1.4, 0.4, True, (0.9, 0.8, 0.7), "beckmann")),
    "paint": of(PAINT),
    "jelly": of(JELLY),
    "jelly from inside": of(JELLY),
    "velvet": of(Sheen((0.9, 0.5, 0.1))),
    "plugin": Material("dust", bsdf=CustomBSDF(LommelSeeliger(), {"albedo": (0.9, 0.6, 0.3)})),
    "transmitting plugin": Material("paper", bsdf=CustomBSDF(Paper(), {"albedo": (0.9, 0.6, 0.3)})),
}
"""Materials with a lobe that is no delta, by name."""
DELTAS = {
    "mirror": conductor(0.0, GOLD),
    "glass": of(Dielectric(1.5, (0.0, 0.0), (0.9, 0.8, 0.7), (0.5, 0.9, 0.8))),
    "pane": of(ThinDielectric(1.5, (0.9, 0.8, 0.7), (0.5, 0.9, 0.8))),
    "nothing": of(Null()),
}
"""Materials of delta lobes alone."""


def transmits(model):
    """Whether light may be refracted through a lobe that is no delta."""
    bsdf = MODELS[model].bsdf
    plugin = isinstance(bsdf, CustomBSDF) and getattr(bsdf.plugin, "transmission", False)
    return plugin or isinstance(bsdf, Dielectric) or (isinstance(bsdf, Principled) and bsdf.spec_trans > 0.0)


def side(model):
    """From which side a model is seen, for `points`."""
    return {"front": not model.endswith("from inside")}


def index_ratio(model):
    """The index of refraction behind the surface over the one before it; 1 for what transmits nothing."""
    bsdf = MODELS[model].bsdf
    index = bsdf.ior if isinstance(bsdf, Dielectric) else bsdf.eta if isinstance(bsdf, Principled) else 1.0
    return index if side(model)["front"] else 1.0 / index


def points(wo, normal=UP, dp_du=EAST, geometric=None, front=True, uv=None):
    """A `SurfaceInteraction` for each `wo`, all with the same frame unless these are (3, n) too."""
    n = wo.shape[1]
    normal, dp_du = (np.broadcast_to(vector, (3, n)).copy() for vector in (normal, dp_du))
    geometric = normal if geometric is None else np.broadcast_to(geometric, (3, n)).copy()
    none = np.zeros(n, np.int64)
    sides = np.full(n, front)
    return SurfaceInteraction(np.zeros((3, n)), wo, geometric, normal, dp_du, sides, none, none, np.zeros(n), uv)


def evaluated(chosen, wo, wi, **frame):
    """(3, n) f of a material for pairs of directions, or for one and many."""
    wo, wi = np.broadcast_arrays(wo, wi)
    return Materials([chosen]).evaluate(points(wo.copy(), **frame), wi.copy())


def density(chosen, wo, wi, **frame):
    """(n,) pdf of a material for pairs of directions, or for one and many."""
    wo, wi = np.broadcast_arrays(wo, wi)
    return Materials([chosen]).pdf(points(wo.copy(), **frame), wi.copy())


def sampled(chosen, wo, draws, **frame):
    """`BSDFSample` of a material at each `wo`, or at one many times; draws (3, n)."""
    wo = np.broadcast_to(wo, (3, draws.shape[1])).copy()
    return Materials([chosen]).sample(points(wo, **frame), *draws)


def polar(degrees, azimuth=0.0):
    """(3, n) directions by their angle from z and around it."""
    theta, phi = np.broadcast_arrays(np.radians(degrees), np.radians(azimuth))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]).reshape(3, -1)


def even_directions(n, seed, sphere=False):
    """(3, n) uniform on the hemisphere around z, or on the sphere."""
    rng = np.random.default_rng(seed)
    z, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
    z = 2.0 * z - 1.0 if sphere else z
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z])


def quadrature(rows, columns, around=0.0):
    """Nodes (3, rows * columns) on the hemisphere and their weights per solid angle: Gauss-Legendre in the angle from z,
    midpoints about it, which lie densest at the azimuth `around`, where a narrow lobe is."""
    x, weight = np.polynomial.legendre.leggauss(rows)
    theta, weight = 0.25 * np.pi * (x + 1.0), 0.25 * np.pi * weight
    t = 2.0 * (np.arange(columns) + 0.5) / columns - 1.0
    azimuth, width = around + 180.0 * t**3, 3.0 * np.pi * t**2 * 2.0 / columns
    weights = (weight * np.sin(theta))[:, None] * width
    return polar(np.repeat(np.degrees(theta), columns), np.tile(azimuth, rows)), weights.reshape(-1)
