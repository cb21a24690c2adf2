"""What an environment holds that may change an engine's images or speed: Python, NumPy, and the packages it renders with."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable
from importlib import metadata

import numpy as np


def described(packages: Iterable[str] | None) -> dict[str, str]:
    """Versions by name, and under "files" a hash of what was installed of `packages`, or of all that there are: two builds of
    a package may have one version."""
    if packages is None:
        found = sorted(metadata.distributions(), key=_name)
    else:
        found = [each for name in sorted(packages) for each in metadata.distributions(name=name)]
    total = hashlib.sha256()
    for each in found:
        total.update(f"{_name(each)}=={each.version}\n{_record(each)}".encode())
    named = {} if packages is None else {_name(each): each.version for each in found}
    return {"python": platform.python_version(), "numpy": np.__version__, **named, "files": total.hexdigest()[:16]}


def _name(distribution: metadata.Distribution) -> str:
    return distribution.metadata["Name"] or ""


def _record(distribution: metadata.Distribution) -> str:
    """The hashes that the installer wrote, but for scripts, which name the environment's folder, and compiled Python."""
    lines = (distribution.read_text("RECORD") or "").splitlines()
    kept = (line for line in lines if not line.startswith("..") and ".pyc," not in line and ".dist-info/" not in line)
    return "\n".join(sorted(kept))
