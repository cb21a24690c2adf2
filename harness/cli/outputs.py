"""Where commands write, looked at before anything is rendered or measured."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from engines.errors import ConfigError


def check_file(output: Path, suffixes: Collection[str], option: str = "-o") -> str:
    """The suffix of a file that an option names, in lower case. Raises `ConfigError` where it is none of `suffixes` (written in
    lower case), or the file cannot be written."""
    suffix = output.suffix.lower()
    if suffix not in suffixes:
        *others, last = suffixes
        raise ConfigError(f"{option} {output}: must end in {', '.join(others)}{' or ' if others else ''}{last}")
    if output.is_dir():
        raise ConfigError(f"{option} {output}: is a folder; a file is expected")
    _check_place(output, option)
    return suffix


def check_folder(output: Path, option: str = "-o") -> None:
    """Raises `ConfigError` where a folder that an option names is a file, or cannot be made or written to."""
    if output.is_dir():
        _check_writable(output, output, option)
    elif output.exists():
        raise ConfigError(f"{option} {output}: is a file; a folder is expected")
    else:
        _check_place(output, option)


def _check_place(output: Path, option: str) -> None:
    if not output.absolute().parent.is_dir():
        raise ConfigError(f"{option} {output}: the folder {output.parent} does not exist")
    _check_writable(output, output.parent, option)


def _check_writable(output: Path, folder: Path, option: str) -> None:
    if not os.access(folder.absolute(), os.W_OK):
        raise ConfigError(f"{option} {output}: the folder {folder} cannot be written to")
