"""The disk cache of machine code: one folder per version of the sources, those long unused removed.

Numba's own cache does not notice a change in a callee of another file, and lies beside the sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

KEPT_DAYS = 30


@cache
def source_hash() -> str:
    """Hash of the sources that become machine code: those that name numba or the kernels."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.parent.rglob("*.py")):
        source = path.read_bytes()
        if b"numba" in source or b"engines.kernels" in source:
            digest.update(path.name.encode() + source)
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where machine code is kept: $NUMBA_CACHE_DIR, else the user's cache folder; one folder per version of the sources."""
    root = os.environ.get("NUMBA_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "raybench"
    )
    return Path(root) / f"kernels-{source_hash()}"


@cache
def _keep_house() -> None:
    """Notes that the folder is in use, and removes those of other versions that nobody has used for `KEPT_DAYS`."""
    folder = cache_folder()
    with suppress(OSError):  # read-only, or another process was first
        os.utime(folder)
        for other in folder.parent.glob("kernels-*"):
            if time.time() - other.stat().st_mtime > KEPT_DAYS * 86_400:
                shutil.rmtree(other, ignore_errors=True)


class _Locator(caching._CacheLocator):
    """Puts cached code into `cache_folder`, stamped with the hash of all sources instead of one file's date."""

    def __init__(self, function: Any, source: str) -> None:
        self._line = function.__code__.co_firstlineno
        self._source = source

    def get_cache_path(self) -> str:
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        return source_hash()

    def get_disambiguator(self) -> str:
        return f"{Path(self._source).stem}{self._line}"

    @classmethod
    def from_function(cls, function: Any, source: str) -> Any:
        locator = cls(function, source)
        try:
            locator.ensure_cache_path()
            _keep_house()
        except OSError:
            return None
        return locator


class _Impl(caching.CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012


class _Cache(caching.FunctionCache):
    _impl_class = _Impl


def cached(function: Any) -> Any:
    """For the attribute `_cache` of what Numba compiles."""
    try:
        return _Cache(function)
    except RuntimeError:  # no folder can be written: compile every time
        return caching.NullCache()
