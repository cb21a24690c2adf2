"""From a user's settings to resolved ones, and to what the jitted engines cannot do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from engines.choices import SAMPLERS, SHADERS, Option, resolve
from engines.interface import Settings
from engines.scene.model import Conductor, CustomCamera, Disk, EnvironmentLight, Scene, SpotLight
from engines.scene.support import first_lacking

LACKS = (Conductor, Disk, SpotLight)


def resolved(settings: Settings, accelerators: Mapping[str, Mapping[str, Option]], precision: str) -> Settings:
    """`settings` with every choice a `Choice` and a precision. Raises `UnknownName` and `ConfigError`."""
    return replace(
        settings,
        shader=resolve("shader", settings.shader, SHADERS),
        sampler=resolve("sampler", settings.sampler, SAMPLERS),
        accelerator=resolve("accelerator", settings.accelerator, accelerators),
        precision=settings.precision or precision,
    )


def plugins(settings: Settings) -> dict[str, Any]:
    """The jitted functions of plugins, by part: `shader` and `sampler` objects carry theirs as `jitted`."""
    parts = {"shader": settings.shader, "sampler": settings.sampler}
    return {part: getattr(choice.plugin, "jitted", None) for part, choice in parts.items() if choice.plugin is not None}


def why_not(scene: Scene, settings: Settings, engine: str) -> str | None:
    """One sentence on what the jitted engines lack for this scene with these resolved settings, or None."""
    for part, function in plugins(settings).items():
        if function is None:
            return (
                f"the {part} {getattr(settings, part).name!r} has no `jitted` function, which the engine {engine} needs"
            )
    if isinstance(scene.camera, CustomCamera) and getattr(scene.camera.plugin, "jitted", None) is None:
        return f"the camera has no `jitted` function, which the engine {engine} needs"
    if sum(isinstance(light, EnvironmentLight) for light in scene.lights) > 1:
        return f"the scene has several environments, of which the engine {engine} renders one"
    if lacking := first_lacking(scene, LACKS):
        return f"the engine {engine} has no {lacking}"
    return None
