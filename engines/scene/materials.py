"""Materials: what engines get, and the keys of a scene file, which are lobes or one BSDF model (`engines.scene.bsdf`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from engines.scene.bsdf import MODELS, Bsdf
from engines.scene.triple import BLACK, Triple
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, POSITIVE, color

__all__ = ["Material"]

ENERGY_TOLERANCE = 1e-9
"""By how much kd + ks + kt may pass 1, so that sums such as 0.6 + 0.3 + 0.1 are not refused for rounding."""


@dataclass(frozen=True, slots=True)
class Material:
    """Surface response: kd Lambertian albedo (f = kd/pi), ks mirror, kt refraction, emission radiance (W/sr/m2).

    With `fresnel` the mirror is weighted by F and the refraction by 1 - F (exact dielectric, unpolarised). Emission
    leaves the front side, or both when `two_sided`. `ior` is relative to the outside of the shape. Where `bsdf` is given
    it replaces kd, ks, kt, ior and fresnel, which then have their defaults.
    """

    name: str
    kd: Triple = BLACK
    ks: Triple = BLACK
    kt: Triple = BLACK
    ior: float = 1.0
    fresnel: bool = False
    emission: Triple = BLACK
    two_sided: bool = False
    bsdf: Bsdf | None = None

    @property
    def energy(self) -> Triple:
        """The share of light that kd, ks and kt return at most, a channel."""
        r, g, b = (
            d + (max(s, t) if self.fresnel else s + t) for d, s, t in zip(self.kd, self.ks, self.kt, strict=True)
        )
        return r, g, b

    @property
    def emits(self) -> bool:
        """Whether any channel of `emission` is above zero."""
        return max(self.emission) > 0.0


def _material(given: Given, context: Any) -> Material:
    """Named by the last step of its path."""
    model = next((name for name in MODELS if given.has(name)), None)
    for key in (*LOBES, *MODELS):
        if model is not None and key != model and given.has(key):
            raise given.node.refuse_key(key, f"either {model}, or {', '.join(LOBES)}")
    shared = {key: given[key] for key in (*LOBES, *EMISSION)}
    material = Material(str(given.node.path[-1]), **shared, bsdf=given[model] if model else None)
    for channel, total in zip(("red", "green", "blue"), material.energy, strict=True):
        if total > 1.0 + ENERGY_TOLERANCE:
            sum_of = "kd + max(ks, kt)" if material.fresnel else "kd + ks + kt"
            raise given.node.refuse(f"{sum_of} = {total:g} in {channel}: must not exceed 1")
    return material


_SHARE = color(1)
LOBES = {
    "kd": Key(_SHARE, "Diffuse (Lambertian) albedo.", 0),
    "ks": Key(_SHARE, "Weight of perfect mirror reflection.", 0),
    "kt": Key(_SHARE, "Weight of perfect refraction.", 0),
    "ior": Key(POSITIVE, "Index of refraction of the inside, relative to the outside.", 1.0),
    "fresnel": Key(BOOLEAN, "Whether ks is weighted by Fresnel's reflectance F and kt by 1 - F, as in glass.", False),
}
EMISSION = {
    "emission": Key(color(), "Radiance that leaves the front side.", 0, unit="W/(sr m²)"),
    "two_sided": Key(BOOLEAN, "Whether the back side emits, too.", False),
}
_CHOICE = {name: Key(model, f"Instead of the keys above. {model.meaning}", None) for name, model in MODELS.items()}
MATERIAL = Record("A surface.", {**LOBES, **_CHOICE, **EMISSION}, _material)
