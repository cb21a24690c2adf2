"""The base class of an adapter's engine: what it takes is listed, and the answers follow."""

from __future__ import annotations

import sys
from collections.abc import Container, Iterator, Mapping
from importlib import metadata, util
from typing import Any

from engines.choices import SAMPLERS, SHADERS, Choice, Option
from engines.errors import Unsupported, why_unsupported
from engines.interface import Settings
from engines.peers.adapters.image_renderer import ImageRenderer
from engines.peers.adapters.lacks import environments_lack, point_lights_lack
from engines.scene import Orthographic, Scene, Texture
from engines.scene.support import foreign, refusal_of

CAMERA_KEYS = {"principal_point": (0.0, 0.0), "mirror": False, "clip": (0.0, float("inf"))}
"""What cameras have besides their kind, with the value that asks for nothing."""
PLAIN_PATHS: Mapping[str, Container[Any]] = {
    "direct": ("mis",),
    "light_candidates": (1,),
    "transparent_shadows": (False,),
    "hide_emitters": (False,),
    "guiding": ("none",),
}
"""Of the options of `path_tracer`, those of a path tracer with multiple importance sampling and nothing special."""


def version_with(package: str, adapter: str = "1") -> str:
    """An engine's version: the adapter's and that of an installed package, as in "1+5.0.1", or "1+none" where it is missing."""
    try:
        return f"{adapter}+{metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"{adapter}+none"


class AdapterEngine:
    """An engine whose class attributes say what it supports; it refuses scenes and settings with anything else.

    `shapes`, `materials`, `textures`, `lights`, `cameras`: types of `engines.scene`, `materials` those of BSDFs, wrappers
    included. `camera_keys`: of `CAMERA_KEYS` those that it honours. `two_sided`: whether it supports
    surfaces that emit on both sides. `lacks` refuses scenes for reasons that types do not tell.

    `takes_shaders`, `takes_samplers`: names, of raybench's or of `own_shaders` and `own_samplers`, each with the options for
    which not every value is honoured, and those that are: `{"path_tracer": {"direct": ("mis",), "rr_depth": range(3, 99)}}`.
    `own_shaders`, `own_samplers`: the renderer's own, each with its options, as in `engines.choices`.

    `renderer`: the class of its renderers. `module`: what must be importable, and `install` how to have it.
    """

    name: str
    version: str = "1"
    renderer: type[ImageRenderer]
    module: str = ""
    install: str = ""
    precision: str = "float32"
    shapes: tuple[type, ...] = ()
    materials: tuple[type, ...] = ()
    textures: tuple[type, ...] = ()
    lights: tuple[type, ...] = ()
    cameras: tuple[type, ...] = ()
    camera_keys: tuple[str, ...] = ()
    two_sided: bool = False
    takes_shaders: Mapping[str, Mapping[str, Container[Any]]] = {"path_tracer": {}}
    takes_samplers: Mapping[str, Mapping[str, Container[Any]]] = {"random": {}}
    own_shaders: Mapping[str, Mapping[str, Option]] = {}
    own_samplers: Mapping[str, Mapping[str, Option]] = {}
    not_promised: Mapping[str, str] = {}

    @property
    def tracing_precision(self) -> str:
        """That of the one precision it has."""
        return self.precision

    def lacks(self, scene: Scene, settings: Settings) -> str | None:
        """One sentence on what the renderer does not support, or None. Choices are resolved; must import nothing."""
        return None

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        """`auto` alone: the renderer chooses its accelerator."""
        return {"auto": {}}

    def shaders(self) -> Mapping[str, Mapping[str, Option]]:
        """Shaders of the renderer's own."""
        return self.own_shaders

    def samplers(self) -> Mapping[str, Mapping[str, Option]]:
        """Samplers of the renderer's own."""
        return self.own_samplers

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """See `engines.interface.Engine`: the first thing that is not listed, then what `lacks` says, then what to install."""
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> ImageRenderer:
        """A `renderer` of the resolved settings; see `engines.interface.Engine`."""
        return self.renderer(self, scene, self._supported(scene, settings))

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        """The resolved settings; raises `Unsupported` for the first thing that is lacking, what has to be installed last."""
        shaders, samplers = {**SHADERS, **self.own_shaders}, {**SAMPLERS, **self.own_samplers}
        chosen = settings.resolved(self.accelerators(), self.precision, shaders, samplers)
        lacking = (*self._settings_lack(chosen), refusal_of(scene), *self._scene_lacks(scene))
        reason = next(filter(None, lacking), None) or self.lacks(scene, chosen) or self._missing()
        if reason is not None:
            raise Unsupported(reason)
        return chosen

    def _missing(self) -> str | None:
        if not self.module or self.module in sys.modules or util.find_spec(self.module) is not None:
            return None
        return f"{self.module} is not installed" + (f": {self.install}" if self.install else "")

    def _settings_lack(self, chosen: Settings) -> Iterator[str | None]:
        if chosen.precision != self.precision:
            yield f"{self.name} computes in {self.precision} only"
        if any(choice.plugin is not None for choice in (chosen.shader, chosen.sampler, chosen.accelerator)):
            yield f"{self.name} takes no plugins"
        yield self._choice_lacks("shader", chosen.shader, self.takes_shaders)
        yield self._choice_lacks("sampler", chosen.sampler, self.takes_samplers)

    def _choice_lacks(self, kind: str, choice: Choice, takes: Mapping[str, Mapping[str, Container[Any]]]) -> str | None:
        if choice.name not in takes:
            return f"{self.name} has no {kind} {choice.name}: known: {', '.join(takes)}"
        for key, values in takes[choice.name].items():
            if choice.options[key] not in values:
                return f"{self.name} has {kind} {choice.name} with {key} {_listed(values)} only"
        return None

    def _scene_lacks(self, scene: Scene) -> Iterator[str | None]:
        camera, name = scene.camera, self.name
        yield foreign(scene, {*self.cameras, *self.shapes, *self.lights, *self.materials, *self.textures}, name)
        for key, default in CAMERA_KEYS.items():
            if key not in self.camera_keys and getattr(camera, key, default) != default:
                yield f"{name} does not support a camera's {key}"
        if isinstance(camera, Orthographic) and camera.width is not None and camera.height is not None:
            yield f"{name} does not support an orthographic camera with a width and a height"
        for material in scene.materials:
            if isinstance(material.emission, Texture):
                yield f"material {material.name!r}: {name} takes no emission from a texture"
            if material.emits and material.two_sided and not self.two_sided:
                yield f"material {material.name!r}: {name} has no surfaces that emit on both sides"
        yield point_lights_lack(scene, name)
        yield environments_lack(scene, name)


def _listed(values: Container[Any]) -> str:
    if isinstance(values, range):
        return f"from {values.start} to {values[-1]}"
    return " or ".join(map(str, values)) if isinstance(values, (tuple, list)) else str(values)


__all__ = ["CAMERA_KEYS", "PLAIN_PATHS", "AdapterEngine", "version_with"]
