"""From a user's settings to resolved ones, and to what the jitted engines cannot do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import numpy as np

from engines.errors import ConfigError, Unsupported
from engines.interface import Settings, Table
from engines.kernels.flatten.lights import ROWS, plugin_parameters
from engines.kernels.flatten.materials import KINDS
from engines.kernels.flatten.programs import WRAPPERS, leaves_in
from engines.kernels.flatten.shapes import ANALYTIC
from engines.kernels.layout import SHADER_OPTIONS
from engines.kernels.rows import BSDF_PARAMETERS, LIGHT_PARAMETERS
from engines.scene import (
    Camera,
    CustomBSDF,
    CustomLight,
    EnvironmentLight,
    HomogeneousMedium,
    Instance,
    Mesh,
    Plane,
    Scene,
    Sphere,
    SphereSet,
    Texture,
    Triangle,
)
from engines.scene.support import foreign, option_numbers, plugin_without, refusal_of


def known() -> frozenset[type]:
    """The types of scenes that are rendered, as the registries have them now."""
    shapes = (Plane, Sphere, SphereSet, Triangle, Mesh, Instance, *ANALYTIC)
    return frozenset({*get_args(Camera), *shapes, *ROWS, *KINDS, *WRAPPERS, *get_args(Texture), HomogeneousMedium})


def no_instances(accelerator: str) -> str:
    """What an accelerator lacks that finds no instances."""
    return f"the accelerator {accelerator} finds no instances"


def supported(scene: Scene, settings: Settings, accelerators: Table, precision: str, engine: str) -> Settings:
    """The settings with every choice resolved. Raises `UnknownName`, `ConfigError`, and `Unsupported` for what the jitted
    engines lack."""
    chosen = settings.resolved(accelerators, precision)
    if lacking := _lacking(scene, chosen, engine):
        raise Unsupported(lacking)
    return chosen


def _plugins(settings: Settings) -> dict[str, Any]:
    """The jitted functions of plugins, by part: `shader` and `sampler` objects carry theirs as `jitted`."""
    parts = {"shader": settings.shader, "sampler": settings.sampler}
    return {part: getattr(choice.plugin, "jitted", None) for part, choice in parts.items() if choice.plugin is not None}


def _lacking(scene: Scene, settings: Settings, engine: str) -> str | None:
    """One sentence on what the jitted engines lack for this scene with these resolved settings, or None."""
    if refusal := refusal_of(scene) or foreign(scene, known(), f"the engine {engine}"):
        return refusal
    for part, function in _plugins(settings).items():
        if function is None:
            return f"the {part} {getattr(settings, part).name!r} has no `jitted` function, which the engine {engine} needs"
        _require_numbers(part, getattr(settings, part), engine)
    given: Any = settings.shader
    if given.plugin is not None and (count := len(option_numbers(given.options))) > SHADER_OPTIONS:
        return f"the options of {given.name!r} are {count} numbers, of which the engine {engine} takes {SHADER_OPTIONS}"
    if lacking := plugin_without(scene, "jitted"):
        return f"{lacking} has no `jitted` function, which the engine {engine} needs"
    for plugin, given, most in _numbers_of_plugins(scene):
        if given > most:
            return f"the options of {plugin.name!r} are {given} numbers, of which the engine {engine} takes {most}"
    if sum(isinstance(light, EnvironmentLight) for light in scene.lights) > 1:
        return f"the scene has several environments, of which the engine {engine} renders one"
    return None


def _require_numbers(part: str, given: Any, engine: str) -> None:
    """Refuses options of a plugin that its jitted function cannot be given."""
    for key, value in given.options.items():
        try:
            option_numbers({key: value})
        except (TypeError, ValueError):
            message = f"{part} {given.name}.{key} = {value!r}: a number is expected, as the engine {engine} takes no others"
            raise ConfigError(message) from None


def _numbers_of_plugins(scene: Scene) -> Iterator[tuple[Any, int, int]]:
    """Each plugin with how many numbers its lane functions are given, and for how many there is room."""
    for light in scene.lights:
        if isinstance(light, CustomLight):
            yield light.plugin, len(plugin_parameters(light, np.zeros(3))), LIGHT_PARAMETERS
    for material in scene.materials:
        for leaf in leaves_in(material):
            if isinstance(leaf, CustomBSDF):
                yield leaf.plugin, len(option_numbers(leaf.options)), BSDF_PARAMETERS
