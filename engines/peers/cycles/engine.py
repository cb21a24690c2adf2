"""What Cycles takes of raybench's scenes and settings, and what it cannot promise."""

from __future__ import annotations

import numpy as np

from engines.interface import Settings
from engines.peers.adapters import MEANS_ALONE, PLAIN_PATHS, AdapterEngine, version_with
from engines.peers.adapters.lacks import OUT_OF_RANGE, out_of_range, textures_lack
from engines.peers.cycles.geometry import spheres_lack
from engines.peers.cycles.renderer import Renderer
from engines.scene import (
    BLACK,
    WHITE,
    Blend,
    Bsdf,
    Checkerboard,
    Conductor,
    Dielectric,
    Diffuse,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Mesh,
    Mixture,
    Null,
    Orthographic,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sides,
    Sphere,
    SphereSet,
    SpotLight,
    ThinDielectric,
    ThinLens,
    Triangle,
)
from engines.scene.bsdf_tree import has_null_lobes, members

ROUGHEST = 0.1
"""Cycles' microfacets shadow and mask each other in correlation, raybench's apart: to this roughness they reflect the same
within 0.1 % wherever the cosine is above 0.3, and at 0.3 no longer within 1 %."""
LEAST_SIDE = 4
DEEP = 32
"""Segments of a path from which on it hardly matters that passing a surface is none there: at 6, half a percent was seen."""
_ROUNDING = "the mean of a call is rounded to float32"


class Engine(AdapterEngine):
    """Blender's Cycles on the CPU, in a separate process and Python environment: a box filter of one pixel, no clamping,
    no adaptive sampling, no path guiding, no denoiser, caustics on; a light tree if `light_sampler` is `bvh`. Float32. Its
    sampler `sobol` is Cycles' table of Owen-scrambled Sobol points.

    Roulette begins after `rr_depth` segments; a path goes on with the square root of its largest throughput, as always in
    Cycles. Passing a mask, a null surface or a thin pane is no segment there, so that these are declined at low `max_depth`.
    """

    name = lineage = "cycles"
    module, install = "bpy", "docs/guides/cycles.md says how"
    renderer = Renderer
    own_process = True  # bpy is under the GPL, and wants a NumPy below 2
    shapes = (Triangle, Mesh, Sphere, SphereSet, Disk, Plane)
    materials = (Mixture, Diffuse, Conductor, Dielectric, ThinDielectric, Null, Mask, Blend, Sides)
    textures = (ImageTexture, Checkerboard)
    lights = (PointLight, SpotLight, DirectionalLight, EnvironmentLight)
    cameras = (Perspective, ThinLens, Orthographic)
    camera_keys = ("principal_point", "clip")
    two_sided = True
    takes_shaders = {  # noqa: RUF012
        "path_tracer": {**PLAIN_PATHS, "max_depth": range(1, 1026), "light_sampler": ("uniform", "bvh")}
    }
    takes_samplers = {"sobol": {"scramble": ("owen",)}}  # noqa: RUF012
    listed = {"sampler": ("sobol",)}  # noqa: RUF012
    not_promised = {  # noqa: RUF012
        **MEANS_ALONE,
        "a_split_render_is_the_same": _ROUNDING,
        "stop_from_a_thread_ends_the_render": "Cycles hears of it between passes, of a quarter of a million paths each",
    }

    @property
    def version(self) -> str:  # type: ignore[override]
        return version_with("bpy", "2")

    def lacks(self, scene: Scene, settings: Settings) -> str | None:
        """What materials, textures, spheres and lights have no exact counterpart; images that are too small."""
        if min(settings.size(scene)) < LEAST_SIDE:
            return f"Blender renders no images of less than {LEAST_SIDE} pixels a side"
        for material in scene.materials:
            lacking = next(filter(None, map(bsdf_lacks, members(material.as_bsdf))), None)
            if lacking is None and any(map(out_of_range, members(material.as_bsdf))):
                lacking = OUT_OF_RANGE
            if lacking is None and has_null_lobes(material.as_bsdf) and settings.shader.options["max_depth"] < DEEP:
                lacking = f"surfaces that rays pass, which are no segments there, unless max_depth is {DEEP} or more"
            if lacking is not None:
                return f"material {material.name!r}: Cycles has no exact counterpart of {lacking}"
        if lacks := textures_lack(scene):
            return lacks
        if any(isinstance(light, SpotLight) and light.texture is not None for light in scene.lights):
            return "textures of lights are not translated for Cycles"
        if any(isinstance(light, EnvironmentLight) and light.rows == "poles" for light in scene.lights):
            return "Cycles has no environments whose rows lie on the poles"
        return spheres_lack(scene)


def bsdf_lacks(part: Bsdf) -> str | None:
    """What of one BSDF or wrapper Cycles has no exact counterpart of, or None."""
    if isinstance(part, Mixture):
        return "refraction without Fresnel's equations" if part.kt != BLACK and not part.fresnel else None
    if not isinstance(part, Conductor | Dielectric):
        return None
    first, second = part.alpha
    if not isinstance(first, int | float) or first != second:
        return "roughness that is a texture, or another one along each tangent"
    if first > ROUGHEST:
        return f"roughness above {ROUGHEST:g}: its microfacets shadow each other otherwise"
    if isinstance(part, Conductor):
        metal = (part.eta, part.k) != (BLACK, WHITE)
        return "metals whose reflectance has a factor" if metal and part.reflectance != WHITE else None
    tinted = part.reflectance != part.transmittance
    return "rough glass with a tint of reflection or of transmission" if tinted and np.any(first) else None


__all__ = ["Engine"]
