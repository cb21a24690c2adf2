"""The scene file that a program is given, by its format.

A format is a function of scene, settings and an empty folder; it returns the file, made in the folder where it is
exported, and raises `Unsupported` for what the format cannot say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from engines.errors import Unsupported
from engines.interface import Settings
from engines.scene.model import Scene

Format = Callable[[Scene, Settings, Path], Path]


def own_file(scene: Scene, settings: Settings, folder: Path) -> Path:
    """The file that the scene was read from."""
    if not scene.source:
        raise Unsupported(f"the scene {scene.name!r} is not in a file as it is: a program cannot be given it")
    return Path(scene.source).absolute()


FORMATS: Mapping[str, Format] = {"raybench": own_file}
