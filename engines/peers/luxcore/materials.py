"""Materials in LuxCore's terms: those that have an exact counterpart."""

from __future__ import annotations

from typing import Any

from engines.scene import BLACK, Bsdf, Conductor, Dielectric, Diffuse, Material, Mixture
from engines.scene.support import model_of

Properties = dict[str, Any]


def material_lacks(material: Material) -> str | None:
    """What of a material LuxCore has no exact counterpart of, or None. Kinds of BSDFs and textures have been looked at."""
    bsdf = model_of(material)
    if isinstance(bsdf, Conductor):
        if bsdf.alpha != (0.0, 0.0):
            return "rough conductors with raybench's microfacets (its own are Schlick's)"
        return None if bsdf.eta == BLACK else "a smooth metal with Fresnel's reflectance"
    if isinstance(bsdf, Dielectric) and bsdf.alpha != (0.0, 0.0):
        return "rough glass with raybench's microfacets (its own are Schlick's)"
    if isinstance(bsdf, Mixture):
        diffuse, mirror, glass = (weights != BLACK for weights in (bsdf.kd, bsdf.ks, bsdf.kt))
        if glass and (diffuse or not bsdf.fresnel):
            return "refraction without Fresnel's equations, or beside a diffuse lobe"
        if mirror and not glass and (diffuse or bsdf.fresnel):
            return "a mirror beside a diffuse lobe, or one with Fresnel's equations and without refraction"
    return None


def material_properties(material: Material) -> Properties:
    """The material without its name: type and parameters, emission included."""
    found = _model(model_of(material))
    if material.emits:
        found |= {
            "emission": list(material.emission), "emission.gain": [1.0] * 3,
            "emission.directlightsampling.type": "ENABLED",  # left to itself it stops at many triangles
        }  # fmt: skip
    return found


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
