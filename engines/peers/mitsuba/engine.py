"""The engines: Mitsuba's JIT-compiled variant for LLVM, and its scalar one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from engines.choices import SAMPLERS as KNOWN_SAMPLERS
from engines.choices import SHADERS, Choice, OpenOptions, Option, integer, one_of
from engines.errors import Unsupported, why_unsupported
from engines.interface import FullPattern, Renderer, Settings
from engines.peers.adapters import version_with
from engines.peers.mitsuba import blends, library, plugins
from engines.peers.mitsuba.albedo import albedo_lacks
from engines.peers.mitsuba.bsdfs import bsdf_node
from engines.peers.mitsuba.description import scene_lacks
from engines.peers.mitsuba.native import file_lacks, require_plugin, size_lacks
from engines.peers.mitsuba.nodes import Placing
from engines.peers.mitsuba.patterns import LARGEST, USUAL, full_pattern
from engines.peers.mitsuba.scalar import renders_images
from engines.peers.mitsuba.textures import Textures
from engines.scene import Camera, Mask, Null, Principled, Scene, ThinLens
from engines.scene.bsdf_tree import members, tilts_null_lobes

_OPTIONS = {"robust": Option(True, "Embree's watertight traversal (embree_use_robust_intersections)", one_of(True, False))}
ACCELERATORS: dict[str, dict[str, Option]] = {"auto": _OPTIONS, "embree": _OPTIONS}


def _count_or_none(value: Any) -> str | None:
    wrong = integer(1, LARGEST)(value)
    return None if value is None or wrong is None else f"{wrong}, or null"


def _word(value: Any) -> str | None:
    return None if isinstance(value, str) and value.isascii() and value.isidentifier() else "a plugin's name"


_MEANING = f"samples per pixel in a pattern, rounded up; null: one pattern a checkpoint, {USUAL} outside an experiment"
_PLUGIN = Option(
    None,
    "module:function that registers plugins of your own with Mitsuba",
    lambda value: None if value is None or (isinstance(value, str) and ":" in value) else "module:function, or null",
)
_PATTERN = {"sample_count": Option(None, _MEANING, _count_or_none)}
SAMPLERS: dict[str, dict[str, Option]] = {
    "independent": {},
    "multijitter": _PATTERN,
    "orthogonal": _PATTERN,
    "ldsampler": _PATTERN,
    "mitsuba": OpenOptions(
        {"type": Option("independent", "name of the sampler's plugin", _word), "plugin": _PLUGIN, **_PATTERN}
    ),
}
"""Mitsuba's own, beside those of raybench that it has too: `random` (its independent) and `stratified`. `mitsuba` is one of the
user's, with its own properties."""
ANY = "of surfaces at the same distance Embree returns any"
_INTEGRATOR = Option("path", "name of the integrator's plugin", _word)
OWN_SHADERS: dict[str, dict[str, Option]] = {"mitsuba": OpenOptions({"type": _INTEGRATOR, "plugin": _PLUGIN})}
"""Mitsuba's integrators: `type` and their own properties, such as max_depth."""
NOT_PROMISED = {"ties_go_to_the_lower_index": ANY, "ties_of_spheres_go_to_the_lower_shape": ANY}


class Engine:
    """Mitsuba 3 (Jakob et al. 2022) as a wavefront on the CPU (`llvm_ad_rgb`), compiled anew for every scene. Float32.

    With `on_pass`, `stop` is heard after every sample per pixel, or where the sampler has patterns, every sixteen. Without, it
    is heard between kernel launches: a second and a half, or seventy times as long as recording one takes where
    surfaces are many; and of patterns as long as it takes to trace four million paths, or a whole pattern of one pixel.
    Shorter launches would make the peer look slow. A pattern that `stop` ends between its launches is dropped.
    """

    name = "mitsuba"
    lineage = "mitsuba"
    packages = ("drjit", "mitsuba")
    variant = library.LLVM
    tracing_precision = "float32"
    not_promised: Mapping[str, str] = NOT_PROMISED
    takes_native = True
    smooth_samplers = ("random", "independent")

    @property
    def version(self) -> str:
        return version_with("mitsuba", "3")

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def samplers(self) -> Mapping[str, Mapping[str, Option]]:
        """Samplers of Mitsuba's own."""
        return SAMPLERS if self.variant == library.LLVM else {"independent": {}}

    def shaders(self) -> Mapping[str, Mapping[str, Option]]:
        """Shaders of Mitsuba's own: its integrators."""
        return OWN_SHADERS

    def full_pattern(self, sampler: Mapping[str, Any], spp: int) -> FullPattern | None:
        """See `engines.interface.HasPatterns` and `engines.peers.mitsuba.patterns.full_pattern`."""
        return full_pattern(sampler, spp)

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        chosen = self._supported(scene, settings)
        from engines.peers.mitsuba import renderer

        return renderer.Renderer(scene, chosen, self.variant)

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        """The settings with every choice resolved; raises `Unsupported` for what is lacking."""
        chosen = settings.resolved(ACCELERATORS, "float32", {**SHADERS, **OWN_SHADERS}, {**KNOWN_SAMPLERS, **SAMPLERS})
        reason = self._settings_lack(chosen) or self._scene_lacks(scene, chosen.shader) or library.lacking(self.variant)
        own = plugins.named(chosen)
        if reason is None and chosen.sampler.name == "mitsuba":
            require_plugin("Sampler", chosen.sampler.options, self.variant, own)
        if reason is None and chosen.shader.name == "mitsuba":
            reason = self._integrator_lacks(chosen, own)
        if reason is None and scene.native is not None:
            reason = size_lacks(scene.native, chosen.size(scene))
            reason = reason or (file_lacks(scene, self.variant, own) if own else file_lacks(scene))
        if reason is not None:
            raise Unsupported(reason)
        return chosen

    def _scene_lacks(self, scene: Scene, choice: Choice) -> str | None:
        shader = choice.name
        if scene.native is not None:
            known = ("path_tracer", "volumetric_path_tracer", "mitsuba")
            ours = shader not in known
            return f"Mitsuba takes its own files with {', '.join(known)}, not with the shader {shader}" if ours else None
        lacks = scene_lacks(scene) or shader_lacks(scene, shader)
        if lacks is None and (choice.options.get("transparent_shadows") or shader == "volumetric_path_tracer"):
            lacks = _null_lobes_lack(scene)
        if lacks is None and self.variant == library.SCALAR:
            lacks = _depth_lacks(scene.camera) if shader == "depth_map" else _blends_lack(scene) if shader != "albedo" else None
        return lacks

    def _integrator_lacks(self, chosen: Settings, own: tuple[str, ...]) -> str | None:
        made = require_plugin("Integrator", chosen.shader.options, self.variant, own)
        if self.variant == library.SCALAR or chosen.sampler.name in ("random", "independent"):
            return None
        with library.active(self.variant, 1):
            mi, _ = library.modules()
            images = renders_images(mi, made)
        kind = chosen.shader.options["type"]
        return f"Mitsuba's {kind} renders whole images, which raybench gives independent samples only" if images else None

    def _settings_lack(self, chosen: Settings) -> str | None:
        shader, sampler = chosen.shader, chosen.sampler
        if chosen.precision != "float32":
            return f"Mitsuba's {self.variant} computes in float32 only"
        if any(choice.plugin is not None for choice in (shader, sampler, chosen.accelerator)):
            return f"the engine {self.name} takes no plugins"
        options = shader.options if shader.name in ("path_tracer", "volumetric_path_tracer") else {}
        if options.get("direct", "mis") != "mis":
            return "Mitsuba's path and volpath find direct light by multiple importance sampling only"
        if options.get("light_sampler", "uniform") != "uniform":
            return "Mitsuba's path and volpath choose lights evenly only"
        if options.get("light_candidates", 1) != 1 or options.get("guiding", "none") != "none":
            return "Mitsuba's path and volpath resample no light samples and guide no paths: light_candidates 1, guiding none"
        if sampler.name not in ("random", "stratified", *SAMPLERS):
            return f"Mitsuba has no sampler {sampler.name}: known: random, stratified, {', '.join(SAMPLERS)}"
        if self.variant == library.SCALAR:
            return _scalar_lacks(shader.name, sampler.name)
        return None


class ScalarEngine(Engine):
    """Mitsuba 3, one path at a time (`scalar_rgb`), with nothing compiled at run time. Float32."""

    name = "mitsuba_scalar"
    variant = library.SCALAR


def _scalar_lacks(shader: str, sampler: str) -> str | None:
    if shader in ("whitted", "no_shadows"):
        return f"Mitsuba has no integrator {shader}, and ours is in Python, too slow for its scalar variant"
    if sampler not in ("random", "independent"):
        return "Mitsuba's scalar variant renders sample by sample here, so that only its independent sampler has a sense"
    return None


def shader_lacks(scene: Scene, shader: str) -> str | None:
    """What of a scene this shader lacks, which is ours and not Mitsuba's, or None."""
    if shader == "albedo":
        return albedo_lacks(scene)
    if shader not in ("whitted", "no_shadows"):
        return None
    for material in scene.materials:
        if any(isinstance(part, (Mask, Null, Principled)) for part in members(material.as_bsdf)):
            return f"material {material.name!r}: in Mitsuba {shader} has no masks, no null and no principled BSDFs"
    return None


def _null_lobes_lack(scene: Scene) -> str | None:
    tilted = (material.name for material in scene.materials if tilts_null_lobes(material.as_bsdf))
    said = "where null lobes are crossed freely Mitsuba's light samples do not pass what lies inside of bump and normal maps"
    return next((f"material {name!r}: {said}" for name in tilted), None)


def _blends_lack(scene: Scene) -> str | None:
    nothing = Textures(Placing(lambda *_: "", lambda *_: {}))
    for material in scene.materials:
        node = bsdf_node(material.as_bsdf, nothing)
        if blends.exact(node) != node:
            return (
                f"material {material.name!r}: Mitsuba's blends of smooth and specular lobes are biased, and the exact one "
                "for the engine mitsuba is in Python, too slow for its scalar variant"
            )
    return None


def _depth_lacks(camera: Camera) -> str | None:
    if isinstance(camera, ThinLens) or getattr(camera, "clip", (0.0,))[0] > 0.0:
        return "Mitsuba's scalar variant measures depth_map from the eye, and not from where rays begin"
    return None


__all__ = ["ACCELERATORS", "SAMPLERS", "Engine", "ScalarEngine"]
