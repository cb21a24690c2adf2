"""Materials: what engines get, and the keys of a scene file, which are lobes or one BSDF model (`engines.scene.bsdf`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from engines.scene.bsdf import MODELS, Bsdf, Sides
from engines.scene.bsdf_tree import attributes, is_opaque, uses_uvs
from engines.scene.models import Mixture
from engines.scene.textures import Color, MeshAttribute, Texture, UVTexture, largest, mean_color, textured_color
from engines.scene.triple import BLACK, Triple, triple
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, POSITIVE, one_of

__all__ = ["Material"]

ENERGY_TOLERANCE = 1e-9
"""By how much kd + ks + kt may pass 1, so that sums such as 0.6 + 0.3 + 0.1 are not refused for rounding."""


@dataclass(frozen=True, slots=True)
class Material:
    """Surface response: kd Lambertian albedo (f = kd/pi), ks mirror, kt refraction, emission radiance (W/sr/m2).

    With `fresnel` the mirror is weighted by F and the refraction by 1 - F (exact dielectric, unpolarised). Emission,
    which may be a texture, leaves the front side, or both when `two_sided`. `ior` is relative to the outside of the
    shape. Where `bsdf` is given it replaces kd, ks, kt, ior and fresnel, which then have their defaults.
    """

    name: str
    kd: Triple = BLACK
    ks: Triple = BLACK
    kt: Triple = BLACK
    ior: float = 1.0
    fresnel: bool = False
    emission: Color = BLACK
    two_sided: bool = False
    bsdf: Bsdf | None = None

    @property
    def as_bsdf(self) -> Bsdf:
        """The BSDF as a whole: `bsdf`, or the `Mixture` of kd, ks and kt where there is none."""
        return self.bsdf or Mixture(self.kd, self.ks, self.kt, self.ior, self.fresnel)

    @property
    def energy(self) -> Triple:
        """The share of light that kd, ks and kt return at most, a channel."""
        return triple(d + (max(s, t) if self.fresnel else s + t) for d, s, t in zip(self.kd, self.ks, self.kt, strict=True))

    @property
    def emits(self) -> bool:
        """Whether any channel of `emission` is above zero, anywhere."""
        return max(self.mean_emission) > 0.0

    @property
    def mean_emission(self) -> Triple:
        """Of a texture, the mean over its texels (`engines.scene.textures.mean_color`)."""
        return mean_color(self.emission) if isinstance(self.emission, Texture) else self.emission

    @property
    def uses_uvs(self) -> bool:
        """Whether light depends on texture coordinates: by its emission or its BSDF (`engines.scene.bsdf_tree.uses_uvs`)."""
        return isinstance(self.emission, UVTexture) or uses_uvs(self.bsdf)

    @property
    def attributes(self) -> set[str]:
        """The names of the mesh attributes that its emission or its BSDF shows."""
        return attributes(self.bsdf) | ({self.emission.name} if isinstance(self.emission, MeshAttribute) else set())


def _material(given: Given, context: Any) -> Material:
    """Named by the last step of its path."""
    model = next((name for name in MODELS if given.has(name)), None)
    for key in (*LOBES, *MODELS):
        if model is not None and key != model and given.has(key):
            raise given.node.refuse_key(key, f"either {model}, or {key if key in MODELS else ', '.join(LOBES)}")
    lobes, emission = {key: given[key] for key in LOBES}, {key: given[key] for key in EMISSION}
    constant: dict[str, Any] = {key: BLACK if isinstance(value, Texture) else value for key, value in lobes.items()}
    name = str(given.node.path[-1])
    plain = Material(name, **constant)
    for channel, total in zip(("red", "green", "blue"), plain.energy, strict=True):
        if total > 1.0 + ENERGY_TOLERANCE:
            sum_of = "kd + max(ks, kt)" if plain.fresnel else "kd + ks + kt"
            raise given.node.refuse(f"{sum_of} = {total:g} in {channel}: must not exceed 1")
    bsdf = given[model] if model else Mixture(**lobes) if lobes != constant else None
    if lobes != constant:
        context.warnings += _too_bright(name, lobes)
    if given["sides"] == "front" and (bsdf or max(plain.energy) > 0.0):
        bsdf = bsdf or Mixture(**lobes)
        if not is_opaque(bsdf):
            raise given.at("sides").refuse("light passes this material: sides belongs to opaque ones, mask included")
        bsdf = Sides(bsdf, None)
    return Material(name, **emission, bsdf=bsdf) if bsdf else Material(name, **lobes, **emission)


def _too_bright(name: str, lobes: Mapping[str, Any]) -> list[str]:
    most: dict[str, Any] = {key: largest(value) if isinstance(value, Texture) else value for key, value in lobes.items()}
    if max(Material(name, **most).energy) <= 1.0 + ENERGY_TOLERANCE:
        return []
    return [f"material {name!r}: where the textures of kd, ks and kt are brightest their sum passes 1"]


_SHARE = textured_color(1)
LOBES = {
    "kd": Key(_SHARE, "Diffuse (Lambertian) albedo.", 0),
    "ks": Key(_SHARE, "Weight of perfect mirror reflection.", 0),
    "kt": Key(_SHARE, "Weight of perfect refraction.", 0),
    "ior": Key(POSITIVE, "Index of refraction of the inside, relative to the outside.", 1.0),
    "fresnel": Key(BOOLEAN, "Whether ks is weighted by Fresnel's reflectance F and kt by 1 - F, as in glass.", False),
}
EMISSION = {
    "emission": Key(textured_color(), "Radiance that leaves the front side.", 0, unit="W/(sr m²)"),
    "two_sided": Key(BOOLEAN, "Whether the back side emits, too.", False),
}
_CHOICE = {name: Key(model, f"Instead of the keys above. {model.meaning}", None) for name, model in MODELS.items()}
_SIDES = Key(
    one_of(("both", "front"), "sides"), "With front the back of the material, which is opaque, reflects nothing.", "both"
)
MATERIAL = Record("A surface.", {**LOBES, **_CHOICE, **EMISSION, "sides": _SIDES}, _material)
