"""What of a scene an engine cannot render, by the types of the scene's parts."""

from __future__ import annotations

from collections.abc import Collection

from engines.scene.model import Conductor, Disk, Scene, SpotLight

_NAMES: dict[type, str] = {Conductor: "conductors", Disk: "disks", SpotLight: "spot lights"}


def first_lacking(scene: Scene, lacks: Collection[type]) -> str | None:
    """What an engine that lacks these types of shapes, lights and BSDFs would have to say of the scene, in a word or two."""
    bsdfs = [material.bsdf for material in scene.materials]
    return next((_NAMES[type(part)] for part in (*scene.shapes, *scene.lights, *bsdfs) if type(part) in lacks), None)
