"""Scenes for other renderers: `export(scene, "mitsuba", path)` writes Mitsuba 3's XML, "pbrt" a file for pbrt-v4."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from engines.errors import ConfigError, UnknownName, Unsupported
from engines.peers.export.mitsuba import write_mitsuba
from engines.peers.export.pbrt import write_pbrt
from engines.scene import Scene
from engines.scene.support import refusal_of

WRITERS: dict[str, tuple[str, Callable[[Scene, Path, int, int], None]]] = {
    "mitsuba": (".xml", write_mitsuba),
    "pbrt": (".pbrt", write_pbrt),
}


def export(scene: Scene, form: str, path: str | Path, max_depth: int = 6, spp: int = 64) -> Path:
    """Writes the scene, its camera and an integrator of `max_depth` segments, for Mitsuba with the `rr_depth` of the scene's
    shader, or else of `path_tracer`; returns the file.

    `path` is a file of the right suffix, or a folder, which is made where it is missing; meshes and images go to a folder
    beside the file. Raises `UnknownName` for other forms, `ConfigError` for a file that cannot be written, and `Unsupported`
    for what that renderer does not support.
    """
    file = file_of(form, path, Path(scene.source).stem or "scene")
    if refusal := refusal_of(scene):
        raise Unsupported(refusal)
    _, write = WRITERS[form]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write(scene, file, max_depth, spp)
    except OSError as problem:
        raise ConfigError(f"{file}: cannot be written: {problem.strerror or problem}") from problem
    return file


def file_of(form: str, path: str | Path, stem: str) -> Path:
    """The file that `path` stands for, a file of a form's suffix or a folder for one of the name `stem`. Raises `UnknownName`
    for other forms, and `ConfigError`."""
    if form not in WRITERS:
        raise UnknownName("renderer to export to", form, WRITERS)
    suffix, _ = WRITERS[form]
    file = Path(path)
    if file.is_dir() or not (file.suffix or file.exists()):
        file = file / f"{stem}{suffix}"
    if file.suffix.lower() != suffix:
        raise ConfigError(f"{path}: must end in {suffix}, or be a folder")
    if file.is_dir():
        raise ConfigError(f"{file}: is a folder; a file is expected")
    return file


__all__ = ["WRITERS", "export", "file_of", "write_mitsuba", "write_pbrt"]
