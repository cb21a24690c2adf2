"""The command line of `raybench view`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple


class ViewOptions(NamedTuple):
    """The scene and engine that the page begins with, the folder that it may read, port 0 for a free one,
    parameters of a Mitsuba file, and whether a `browser` is opened."""

    scene: str
    folder: Path
    port: int
    engine: str
    allow_imports: bool = False
    allow_outside: bool = False
    parameters: Mapping[str, str] = MappingProxyType({})
    browser: bool = True
