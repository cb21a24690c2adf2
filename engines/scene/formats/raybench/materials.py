"""Materials of a scene file, each a record of lobes or one model. A model is one entry of `MODELS`."""

from __future__ import annotations

from typing import Any

from engines.scene.formats.raybench.plugins import PluginKind
from engines.scene.metals import METALS
from engines.scene.model import BLACK, ENERGY_TOLERANCE, WHITE, Conductor, CustomBSDF, Material
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import BOOLEAN, POSITIVE, Kind, color, one_of, within
from engines.schema.yaml_file import Located

SMOOTHEST = 1e-4
"""The least roughness above 0, as in Mitsuba."""


def _alpha(node: Located) -> tuple[float, float]:
    """A number, or [along the first tangent, along the second]: both 0, or both in [SMOOTHEST, 1]."""
    items = node.value if isinstance(node.value, list) else [node]
    if isinstance(node.value, list) and len(items) != 2:
        raise node.refuse("must be a number, or two")
    found = [fields.number(item) for item in items]
    for item in items if any(found) else ():
        if not SMOOTHEST <= item.value <= 1.0:
            raise item.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return found[0], found[-1]


def _conductor(given: Given, context: Any) -> Conductor:
    if given["reflectance"] is not None:
        if given.has("specular_reflectance"):
            raise given.node.refuse_key("specular_reflectance", "a factor of metal, or eta and k: reflectance is all there is")
        return Conductor(BLACK, WHITE, given["alpha"], given["reflectance"])  # Fresnel's equations give 1
    eta, k = METALS[given["metal"]] if given["metal"] else (given["eta"], given["k"])
    return Conductor(eta, k, given["alpha"], given["specular_reflectance"])


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


_ROUGHNESS = within(0, 1).json
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
MODELS = {
    "conductor": Record("A metal with GGX microfacets: its name, or eta and k, or its reflectance alone.", {
        "metal": Key(one_of(METALS, "metal"), "Chemical symbol of the metal, for its eta and k.", None),
        "eta": Key(color(), "Real part of the complex index of refraction.", None),
        "k": Key(color(), "Imaginary part of the complex index of refraction.", None),
        "reflectance": Key(_SHARE, "Reflectance at every angle, instead of Fresnel's equations.", None),
        "alpha": Key(
            Kind(_alpha, {"anyOf": [_ROUGHNESS, {"type": "array", "items": _ROUGHNESS, "minItems": 2, "maxItems": 2}]}),
            f"GGX roughness, or two along the tangents; 0 is smooth, else at least {SMOOTHEST:g}.", 0,
        ),
        "distribution": Key(one_of(("ggx",), "distribution"), "Distribution of the microfacets' normals.", "ggx"),
        "specular_reflectance": Key(_SHARE, "Factor of the reflectance that follows from metal, or from eta and k.", 1),
    }, _conductor, either=(("metal",), ("eta", "k"), ("reflectance",))),
    "plugin": PluginKind("BSDF", "A BSDF of one's own; loaded with --allow-imports alone.", CustomBSDF),
}  # fmt: skip
_CHOICE = {name: Key(model, f"Instead of the keys above. {model.meaning}", None) for name, model in MODELS.items()}
MATERIAL = Record("A surface.", {**LOBES, **_CHOICE, **EMISSION}, _material)
