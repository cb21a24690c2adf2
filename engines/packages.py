"""Commands that install what is missing into the Python that runs.

raybench is in no package index: its extras are those of a checkout, and an installed wheel names their packages instead.
"""

from __future__ import annotations

import os
import shlex
import sys
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def install(*arguments: str) -> str:
    """A shell command of this Python's pip, such as `.venv/bin/python -m pip install 'embreex>=4.4'`."""
    return " ".join([shlex.quote(_near(sys.executable or "python3")), "-m pip install", *map(shlex.quote, arguments)])


def install_extra(extra: str) -> str:
    """The command that installs an extra of raybench: from the checkout that raybench runs from, otherwise its packages."""
    if (ROOT / "pyproject.toml").is_file():
        return install("-e", f"{_near(str(ROOT))}[{extra}]")
    return install(*_packages(extra))


def _packages(extra: str) -> list[str]:
    from packaging.requirements import Requirement

    required = map(Requirement, metadata.requires("raybench") or [])
    of_extra = (one for one in required if one.marker is not None and one.marker.evaluate({"extra": extra}))
    return [f"{one.name}{one.specifier}" for one in of_extra]


def _near(path: str) -> str:
    """A path within the working directory is named from there."""
    try:
        here = os.getcwd()
    except OSError:
        return path
    return os.path.relpath(path, here) if Path(path).is_relative_to(here) else path


__all__ = ["install", "install_extra"]
