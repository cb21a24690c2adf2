"""The scenes that a page may open: the shipped ones, and scene files below one folder."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from engines.errors import ConfigError, suggestion
from engines.input_files import open_regular
from engines.scene import names_a_file
from harness.config import paths
from harness.store import confined

MAX_LISTED = 500
MAX_VISITED = 20_000
HEAD = 4096
"""A file is listed where the key `raybench_scene` is in its first bytes, or the element `scene` of a Mitsuba file."""
SUFFIXES = (".yaml", ".yml", ".xml")
UNLISTED = ("results", "node_modules", "__pycache__")


class Library:
    """Scenes by the names that a page shows: bare names of shipped scenes, paths relative to `folder` of others. `parameters`:
    of scenes by name, values of `$NAME` in Mitsuba files."""

    def __init__(self, folder: Path, parameters: Mapping[str, Mapping[str, str]] | None = None) -> None:
        self.folder, self.parameters = folder.resolve(), parameters or {}

    def names(self) -> list[str]:
        """The names of shipped scenes, then those of files below the folder."""
        shipped = paths.shipped("scenes")
        held = {path.resolve() for path in shipped.values()}
        return [*shipped, *(str(p.relative_to(self.folder)) for p in self._files() if p.resolve() not in held)]

    def _files(self) -> list[Path]:
        scenes: list[Path] = []
        seen = 0
        for place, folders, files in os.walk(self.folder):
            folders[:] = sorted(name for name in folders if name[:1] not in "._" and name not in UNLISTED)
            for name in sorted(files):
                seen += 1
                path = Path(place, name)
                if name.endswith(SUFFIXES) and _is_scene(path):
                    scenes.append(path)
            if seen > MAX_VISITED or len(scenes) >= MAX_LISTED:
                break
        return scenes[:MAX_LISTED]

    def find(self, name: str) -> Path:
        """The file of a name. Raises `ConfigError` where there is none, or where the path leaves the folder."""
        shipped = paths.shipped("scenes")
        if name in shipped:
            return shipped[name].resolve()
        if "/" not in name and not names_a_file(name):
            raise ConfigError(f"unknown scene {name!r}: {suggestion(name, shipped)}")
        path = self.inside(name)
        if not path.is_file():
            raise ConfigError(f"scene {name!r}: there is no such file below {self.folder}")
        return path

    def name_of(self, name: str) -> str:
        """The name of a scene given on the command line, as a path relative to the working folder or a bare name."""
        here = Path(name).expanduser()
        if ("/" in name or name.endswith(SUFFIXES)) and here.is_file():
            resolved = here.resolve()
            if not resolved.is_relative_to(self.folder):
                raise ConfigError(f"{name}: is outside {self.folder}: choose another --folder")
            return str(resolved.relative_to(self.folder))
        self.find(name)
        return name

    def inside(self, name: str, what: str = "scene") -> Path:
        """The path of `name` below the folder, which need not exist. Raises `ConfigError` where it leaves the folder."""
        return confined.inside(self.folder, name, what).resolve()


def _is_scene(path: Path) -> bool:
    try:
        with open_regular(path) as file:
            return (b"<scene" if path.suffix == ".xml" else b"raybench_scene") in file.read(HEAD)
    except OSError:
        return False
