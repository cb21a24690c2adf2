"""What LuxCoreRender takes of raybench's scenes and settings, and what it cannot promise."""

from __future__ import annotations

from engines.interface import Settings
from engines.packages import install_extra
from engines.peers.adapters import MEANS_ALONE, PLAIN_PATHS, AdapterEngine, version_with
from engines.peers.adapters.lacks import textures_lack
from engines.peers.luxcore.materials import material_lacks
from engines.peers.luxcore.renderer import Renderer
from engines.scene import (
    Conductor,
    Cylinder,
    Dielectric,
    Diffuse,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    ImageTexture,
    Instance,
    Mesh,
    Mixture,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SphereSet,
    ThinLens,
    Triangle,
)

_TIMING = "how many samples a pixel has beyond those asked for depends on timing"
_SHARED = "its threads take turns at one stream of pixels: images are equal in distribution only"


class Engine(AdapterEngine):
    """LuxCoreRender's path tracer on the CPU (PATHCPU with its sampler RANDOM), in a separate process: a box filter of one
    pixel, no clamping, no adaptive sampling, no caches, no denoiser. Float32. Lights are chosen with equal probability. Shapes
    that share a material share their probabilities in proportion to their numbers of triangles, not to their areas.

    There is no Russian roulette: LuxCore's is biased beside multiple importance sampling (2.4 % in a closed box of albedo 1/2
    from the third segment on), so that `rr_depth` below `max_depth` is declined. It stops by being polled: pixels have up to
    a few samples more than were asked for, which the film counts.

    Spot lights are declined: LuxCore's are brighter away from their axis.
    """

    name = lineage = "luxcore"
    module, install = "pyluxcore", install_extra("luxcore")
    renderer = Renderer
    own_process = True  # beside numba or llvmlite it ends the process: free(): invalid pointer
    overshoots = True
    shapes = (Triangle, Mesh, Sphere, SphereSet, Disk, Cylinder, Plane)
    materials = (Mixture, Diffuse, Dielectric, Conductor)
    textures = (ImageTexture,)
    lights = (PointLight, DirectionalLight, EnvironmentLight)
    cameras = (Perspective, ThinLens)
    camera_keys = ("principal_point", "clip")
    two_sided = True
    takes_shaders = {  # noqa: RUF012
        "path_tracer": {**PLAIN_PATHS, "max_depth": range(2, 1001), "light_sampler": ("uniform", "power")}
    }
    not_promised = {  # noqa: RUF012
        **MEANS_ALONE,
        "a_split_render_is_the_same": "every call begins another stream of random numbers",
        "warm_up_leaves_the_film_untouched": _TIMING,
        "threads_change_nothing": _SHARED,
        "seeds_matter": _TIMING,
        "on_pass_sees_the_film_grow": _TIMING,
        "a_render_is_not_disturbed": _TIMING,
        "update_takes_the_size_of_the_camera": _SHARED,
        "lossless_glass_is_invisible_in_a_furnace": "it chooses between reflection and refraction by another probability than "
        "Fresnel's, so that single paths do not carry 1, but their mean",
        "stop_in_a_callback_ends_the_render": _TIMING,
        "stop_at_rest_does_nothing": _TIMING,
        "update_of_the_camera_starts_anew": _SHARED,
        "update_of_the_shapes_starts_anew": _SHARED,
    }

    @property
    def version(self) -> str:  # type: ignore[override]
        return version_with("pyluxcore")

    def lacks(self, scene: Scene, settings: Settings) -> str | None:
        """Roulette, materials without an exact counterpart, lights of other shapes than triangles, environments of images."""
        options = settings.shader.options
        if options["rr_depth"] < options["max_depth"]:
            return "LuxCore's Russian roulette is biased, it brightens images: rr_depth must be max_depth or more"
        for material in scene.materials:
            if lacking := material_lacks(material):
                return f"material {material.name!r}: LuxCore has no exact counterpart of {lacking}"
        if any(isinstance(light, EnvironmentLight) and light.image is not None for light in scene.lights):
            return "LuxCore's environments of images are not translated"
        if lacks := textures_lack(scene):
            return lacks
        for shape in scene.shapes:
            if not isinstance(shape, (Triangle, Mesh, Instance)) and scene.materials[shape.material].emits:
                return f"LuxCore has area lights of triangles only, not of the kind {type(shape).__name__}"
        return None
