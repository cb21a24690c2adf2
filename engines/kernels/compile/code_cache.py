"""The disk cache of machine code: one folder per version of the sources, those long unused removed.

Numba's own cache does not notice a change in a callee of another file, and keeps an index per function that is read,
changed and written without a lock: two processes that compile at once can be given each other's code. Here a file holds
the code of one key, is named by a hash of that key, appears whole, and is believed only where key and checksum agree.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import caching, serialize

from engines.kernels.compile.fingerprint import NotFingerprinted, fingerprint

KEPT_DAYS = 30
COMPILED = (
    "choices.py",
    "dahlquist",
    "embree",
    "kernels",
    "light_cells.py",
    "numba_cpu",
    "plugin.py",
    "sd_tree.py",
    "sobol_numbers.py",
)
"""Files and folders of `engines` from which kernels take functions and constants. From others they import classes and Python
functions alone, of which nothing becomes machine code."""
_FORMAT = b"raybench machine code 1\n"
_DIGEST_BYTES = hashlib.sha256().digest_size


class NotOnDisk(Exception):
    """Raised within `loading_only` instead of compiling."""


_this_thread = threading.local()


def is_loading_only() -> bool:
    return getattr(_this_thread, "loading_only", False)


@contextmanager
def loading_only() -> Iterator[None]:
    """Within, this thread loads code, and compiles none that could be kept on disk: `NotOnDisk` is raised instead."""
    _this_thread.loading_only = True
    try:
        yield
    finally:
        _this_thread.loading_only = False


@cache
def source_hash() -> str:
    """Hash of the compiler's version and of the sources of `engines` that become machine code."""
    return hash_of_sources(Path(__file__).parents[2])


def hash_of_sources(root: Path) -> str:
    """Hash of every Python file of `COMPILED` below `root`, and of the compiler."""
    versions = (numba.__version__, llvmlite.__version__, sys.implementation.cache_tag)
    digest = hashlib.sha256(repr(versions).encode())
    for path in sorted(path for name in COMPILED for path in _python_files(root / name)):
        source = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()} {len(source)}\n".encode() + source)
    return digest.hexdigest()[:16]


def _python_files(place: Path) -> list[Path]:
    return [place] if place.is_file() else list(place.rglob("*.py"))


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
    """Puts cached code into `cache_folder`, stamped with the hash of the sources instead of one file's date."""

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


class KeyedFiles:
    """Files of one function, one per key. Has the methods of Numba's `IndexDataCacheFile` that loading and
    saving call."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def path(self, key: Any) -> Path:
        """The file of `key`, whose representation must be the same in every process."""
        return self._folder / f"{self._name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.code"

    def load(self, key: Any) -> Any:
        """The data saved for `key`, or None: nothing is there, it cannot be read, is damaged, or belongs to another key."""
        try:
            content = self.path(key).read_bytes()
        except OSError:
            return None
        start = len(_FORMAT) + _DIGEST_BYTES
        payload = content[start:]
        if content[:start] != _FORMAT + hashlib.sha256(payload).digest():
            return None
        try:
            saved_key, data = pickle.loads(payload)
        except Exception:  # written by a Python or Numba whose classes differ
            return None
        return data if saved_key == key else None

    def save(self, key: Any, data: Any) -> None:
        """Keeps `data` for `key`; where the folder cannot be written, nothing is kept."""
        payload = serialize.dumps((key, data))
        path = self.path(key)
        temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
        try:
            temporary.write_bytes(_FORMAT + hashlib.sha256(payload).digest() + payload)
            os.replace(temporary, path)
        except OSError:
            with suppress(OSError):
                temporary.unlink()


class _Cache(caching.FunctionCache):
    _impl_class = _Impl

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = KeyedFiles(Path(self.cache_path), self._impl.filename_base)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's own key pickles what a function closes over, and a jitted function is never pickled the same way twice."""
        return sig, codegen.magic_tuple(), fingerprint(self._py_func)

    def _save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # the folder has become read-only
            super()._save_overload(sig, data)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        loaded = None
        with suppress(Exception):  # whole, of this key, and yet not to be linked: compiled anew
            loaded = super()._load_overload(sig, target_context)
        if loaded is None and is_loading_only():
            raise NotOnDisk
        return loaded


def cached(function: Any) -> Any:
    """For the attribute `_cache` of what Numba compiles."""
    try:
        fingerprint(function)
        return _Cache(function)
    except (RuntimeError, NotFingerprinted):  # no folder can be written, or it has no name: compile every time
        return caching.NullCache()
