"""Paths that files name, kept inside the folder they are relative to: no `..`, no absolute path, no link that leads out.

Results folders come from other people. What they name is read, copied and written by commands of ours, so every such
path goes through `inside`, and every id that becomes part of a path through `ID`.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from engines.errors import ConfigError

ID = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}$"
"""What an id may look like: a name as hashes have it, which is one part of a path and never `..`."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\\]")


def is_relative(text: str) -> bool:
    """Whether it is written as a path below a folder: relative, without `..`, empty parts and control characters."""
    if not text or len(text) > 1000 or _CONTROL.search(text) or text.startswith(("/", "~")):
        return False
    parts = text.split("/")
    return ".." not in parts and "" not in parts and PurePosixPath(text).parts != ()


def inside(folder: Path, relative: str | Path, what: str) -> Path:
    """The path `relative` below `folder`, which need not exist. `what` names file and field in the refusal.

    Raises `ConfigError` where the path, or a link on its way, leads out of the folder.
    """
    refused = ConfigError(f"{what} = {str(relative)[:200]!r}: leads out of {folder}: a path inside that folder is expected")
    try:
        root, path = folder.resolve(), (folder / relative).resolve()
    except (OSError, ValueError, RuntimeError):  # a loop of links, a NUL
        raise refused from None
    if not path.is_relative_to(root):
        raise refused
    return folder / relative
