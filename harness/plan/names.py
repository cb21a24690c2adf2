"""What tables call engines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from engines.errors import ConfigError
from engines.interface import Engine
from engines.registry import is_file, split


def names_of(engines: Mapping[str, Engine]) -> dict[str, str]:
    """Names by what an experiment writes. An engine for which a Python is named has the version of its renderer in its name,
    and where two environments hold one version, the environment's folder, too."""
    names = {written: _name(written, engine) for written, engine in engines.items()}
    shared = {name for name, count in Counter(names.values()).items() if count > 1}
    names |= {
        written: f"{name} ({_folder(python)})"
        for written, name in names.items()
        if name in shared and (python := split(written)[1])
    }
    for name, count in Counter(names.values()).items():
        alike = [written for written, each in names.items() if each == name]
        if count > 1 and any(split(written)[1] for written in alike):
            raise ConfigError(f"{' and '.join(alike)}: both would be called {name}: folders of other names are expected")
    return names


def _name(written: str, engine: Engine) -> str:
    base, python = split(written)
    name = engine.name if ":" in base or is_file(written) else base
    return name if python is None else f"{name} {renderer_version(engine)}"


def renderer_version(engine: Engine) -> str:
    """The version of what an engine adapts: what stands behind the last + of its own."""
    return str(engine.version).rpartition("+")[2]


def _folder(python: str) -> str:
    """The name of an environment's folder, which may be named by the Python in it."""
    path = Path(python)
    return path.parent.parent.name if path.parent.name in ("bin", "Scripts") else path.name
