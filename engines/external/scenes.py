"""The scene file that a program is given: the scene's own, or one exported for it."""

from __future__ import annotations

from pathlib import Path

from engines.errors import Unsupported
from engines.interface import Settings
from engines.scene.model import Scene


def scene_file(form: str, scene: Scene, settings: Settings, folder: Path) -> Path:
    """The file, made in `folder` where it is exported. Raises `Unsupported` for what the format cannot say."""
    if form == "raybench":
        if not scene.source:
            raise Unsupported(f"the scene {scene.name!r} is not in a file as it is: a program cannot be given it")
        return Path(scene.source).absolute()
    raise Unsupported(f"scenes are not exported to {form} yet")
