"""Materials in LuxCore's terms: those that have an exact counterpart."""

from __future__ import annotations

from typing import Any

from engines.peers.adapters.colors import mirror_share
from engines.peers.adapters.lacks import OUT_OF_RANGE, is_diffuse, mixture_lacks, out_of_range
from engines.scene import BLACK, Bsdf, Conductor, Dielectric, Diffuse, ImageTexture, Material, Mixture
from engines.scene.bsdf_tree import textures

Properties = dict[str, Any]


def texture_of(material: Material) -> ImageTexture | None:
    """The image on a diffuse material, or None."""
    texture = next(textures(material.as_bsdf), None)
    return texture if isinstance(texture, ImageTexture) else None


def _texture_lacks(material: Material, texture: ImageTexture) -> str | None:
    bsdf = material.as_bsdf
    if not is_diffuse(bsdf):
        return "textures on anything but a diffuse BSDF"
    if (texture.filter, texture.wrap) != ("bilinear", "repeat"):
        return "textures other than bilinear, repeated ones"
    return OUT_OF_RANGE if out_of_range(bsdf) else None


def material_lacks(material: Material) -> str | None:
    """What of a material LuxCore has no exact counterpart of, or None. Kinds of BSDFs and textures have been looked at."""
    bsdf, texture = material.as_bsdf, texture_of(material)
    if texture is not None:
        return _texture_lacks(material, texture)
    if isinstance(bsdf, Conductor):
        if bsdf.alpha != (0.0, 0.0):
            return "rough conductors with raybench's microfacets (its own are Schlick's)"
        return None if bsdf.eta == BLACK else "a smooth metal with Fresnel's reflectance"
    if isinstance(bsdf, Dielectric) and bsdf.alpha != (0.0, 0.0):
        return "rough glass with raybench's microfacets (its own are Schlick's)"
    return mixture_lacks(bsdf) if isinstance(bsdf, Mixture) else None


def material_properties(name: str, material: Material, importance: float) -> Properties:
    """The material called `name`, emission included, and before it what it is made of; `importance` of an emitting triangle."""
    bsdf = material.as_bsdf
    named: Properties = {}
    if texture_of(material) is not None:
        whole: Properties = {"type": "matte", "kd": f"{name}_map"}
    elif isinstance(bsdf, Mixture) and BLACK not in (bsdf.kd, bsdf.ks):
        kd, ks, share = _rgb(bsdf.kd), _rgb(bsdf.ks), mirror_share(bsdf)
        lobes = {"diffuse": ("matte", "kd", kd, 1.0 - share), "mirror": ("mirror", "kr", ks, share)}
        for part, (kind, key, color, weight) in lobes.items():
            named |= {f"{name}_{part}.type": kind, f"{name}_{part}.{key}": [value / weight for value in color]}
        whole = {"type": "mix", "material1": f"{name}_diffuse", "material2": f"{name}_mirror", "amount": share}
    else:
        whole = _model(bsdf)
    if material.emits:
        whole |= {
            "emission": list(material.mean_emission),
            "emission.gain": [1.0] * 3,
            "emission.importance": importance,
            "emission.directlightsampling.type": "ENABLED",  # left to itself it stops at many triangles
        }
    return named | {f"{name}.{key}": value for key, value in whole.items()}


def _model(bsdf: Bsdf) -> Properties:
    if isinstance(bsdf, Diffuse):
        return {"type": "matte", "kd": _rgb(bsdf.reflectance)}
    if isinstance(bsdf, Conductor):
        return {"type": "mirror", "kr": _rgb(bsdf.reflectance)}
    if isinstance(bsdf, Dielectric):
        return _glass(bsdf.reflectance, bsdf.transmittance, bsdf.ior)
    assert isinstance(bsdf, Mixture)
    if bsdf.kt != BLACK:
        return _glass(bsdf.ks, bsdf.kt, bsdf.ior)
    return {"type": "mirror", "kr": _rgb(bsdf.ks)} if bsdf.ks != BLACK else {"type": "matte", "kd": _rgb(bsdf.kd)}


def _glass(reflected: Any, transmitted: Any, ior: float) -> Properties:
    return {"type": "glass", "kr": _rgb(reflected), "kt": _rgb(transmitted), "interiorior": float(ior), "exteriorior": 1.0}


def _rgb(color: Any) -> list[float]:
    return [float(value) for value in color]
