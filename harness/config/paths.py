"""Where scenes and experiments are found: by path, or by bare name in `scenes/` and `configs/`.

A path is looked up beside the file that names it, then in the working directory. A bare name is looked up in the
working directory's folder, then in the checkout's or the wheel's.
"""

from __future__ import annotations

import os
from pathlib import Path

from engines.errors import ConfigError, suggestion
from engines.scene import names_a_file

_PACKAGE = Path(__file__).resolve().parents[1]


def folders(kind: str) -> list[Path]:
    """The folders that hold `scenes` or `configs`, best first."""
    places = [Path.cwd() / kind, _PACKAGE.parent / kind, _PACKAGE / "_shipped" / kind]
    return [place for index, place in enumerate(places) if place.is_dir() and place not in places[:index]]


def shipped(kind: str) -> dict[str, Path]:
    """Bare names with their files, sorted; the working directory's hide the others."""
    found: dict[str, Path] = {}
    for folder in folders(kind):
        for pattern in ("*.y*ml", "*.xml")[: 2 if kind == "scenes" else 1]:
            for path in sorted(folder.glob(pattern)):
                found.setdefault(path.stem, path)
    return dict(sorted(found.items()))


def comes_with_raybench(path: Path) -> bool:
    """Whether a file lies in the checkout's or the wheel's folders."""
    places = [_PACKAGE.parent / kind for kind in ("scenes", "configs")] + [_PACKAGE / "_shipped"]
    return any(path.resolve().is_relative_to(place.resolve()) for place in places)


def shipped_file(kind: str, name: str) -> Path | None:
    """The file that a bare name finds; None where it finds none."""
    found = shipped(kind).get(name)
    return found.resolve() if found else None


def shown(path: Path) -> str:
    """A path for messages and files that others read: from the working directory or the checkout, if it lies below."""
    for root in (Path.cwd(), _PACKAGE.parent):
        if path.is_relative_to(root):
            return str(path.relative_to(root))
    return str(path)


def find(kind: str, given: str, beside: Path | None = None) -> Path:
    """The file of a `scenes` or `configs` name or path; raises `ConfigError` with the nearest known name.

    What lies at a path may be anything: readers refuse all but regular files.
    """
    looks_like_path = "/" in given or names_a_file(given)
    for folder in ([beside] if beside else []) + [Path.cwd()]:
        candidate = os.path.join(folder, os.path.expanduser(given))
        if looks_like_path and os.path.exists(candidate):  # where Path.exists raises for names that are too long
            return Path(candidate).resolve()
    known = shipped(kind)
    if given in known:
        return known[given].resolve()
    noun = {"scenes": "scene", "configs": "experiment"}[kind]
    if looks_like_path:
        raise ConfigError(f"{noun} {given!r}: there is no such file")
    there = ", and what lies there has no suffix of a scene" if os.path.exists(given) else ""
    raise ConfigError(f"unknown {noun} {given!r}{there}: {suggestion(given, known)}")
