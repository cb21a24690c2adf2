"""Scenes for other renderers: `export(scene, "mitsuba", path)` writes Mitsuba 3's XML, "pbrt" a file for pbrt-v4."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from engines.errors import ConfigError, UnknownName, Unsupported
from engines.export.mitsuba import write_mitsuba
from engines.export.pbrt import write_pbrt
from engines.scene import Scene
from engines.scene.support import refusal_of

WRITERS: dict[str, tuple[str, Callable[[Scene, Path, int, int], None]]] = {
    "mitsuba": (".xml", write_mitsuba),
    "pbrt": (".pbrt", write_pbrt),
}


def export(scene: Scene, form: str, path: str | Path, max_depth: int = 6, spp: int = 64) -> Path:
    """Writes the scene, its camera and an integrator of `max_depth` segments; returns the file.

    `path` is a file of the right suffix, or a folder; meshes and images go to a folder beside the file. Raises
    `UnknownName` for other forms, and `Unsupported` for what that renderer has no counterpart of.
    """
    if form not in WRITERS:
        raise UnknownName("renderer to export to", form, WRITERS)
    if refusal := refusal_of(scene):
        raise Unsupported(refusal)
    suffix, write = WRITERS[form]
    file = Path(path)
    if file.suffix != suffix:
        if file.suffix and not file.is_dir():
            raise ConfigError(f"{path}: must end in {suffix}, or be a folder")
        file = file / f"{Path(scene.source).stem or 'scene'}{suffix}"
    file.parent.mkdir(parents=True, exist_ok=True)
    write(scene, file, max_depth, spp)
    return file


__all__ = ["WRITERS", "export", "write_mitsuba", "write_pbrt"]
