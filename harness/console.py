"""What commands share: where they print, and whether code of the working directory may be imported."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

WIDTH_WITHOUT_TERMINAL = 160


def consoles() -> tuple[Console, Console]:
    """(stdout, stderr); what is not a terminal has room for wide tables."""
    made = [Console(stderr=stderr, highlight=False) for stderr in (False, True)]
    for console in made:
        if not console.is_terminal:
            console.width = WIDTH_WITHOUT_TERMINAL
    return made[0], made[1]


def allow_here(allow_imports: bool) -> None:
    """Code that files name may lie in the working directory."""
    here = str(Path.cwd())
    if allow_imports and here not in sys.path:
        sys.path.insert(0, here)
