"""The LLVM that Dr.Jit compiles with: the one that the user names, else the system's, else that of the wheel.

Dr.Jit loads a library once, when it is imported: the one in `VARIABLE`, else the system's, however old. So it is chosen before,
by the names of files, and no other is loaded.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path

from engines.errors import Unsupported
from engines.packages import install_extra

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 17
"""Dr.Jit loads older ones too, some of which end the process while they compile ("Cannot select ... fminimum")."""
WHEEL = "karellen-llvm-core"
_CACHED = re.compile(r"(libLLVM\S*) \(libc6,(?:x86-64|AArch64)[^)]*\) => (.+)")
_VERSION = re.compile(r"libLLVM(?:-|\.so\.)(\d+)")


def find() -> str | None:
    """The path or name of the library, None where Dr.Jit is left to look (elsewhere than on Linux). Raises `Unsupported`."""
    named = os.environ.get(VARIABLE)
    if named:
        if os.sep in named and not Path(named).exists():
            raise Unsupported(lacking(f"{named} does not exist"))
        return named
    if sys.platform != "linux":
        return None
    newest, path = _system(os.environ.get("LD_LIBRARY_PATH", ""), os.environ.get("PATH", ""))
    if newest < OLDEST:
        path = _of_wheel()
    if path is None:
        raise Unsupported(lacking(f"only {newest} was found" if newest else "none was found"))
    return path


def lacking(found: str) -> str:
    """One sentence on what is needed and what was found instead."""
    if os.environ.get(VARIABLE):
        remedy = f"unset {VARIABLE}, or name another there"
    elif sys.platform == "linux" and platform.machine() == "x86_64":
        remedy = install_extra("mitsuba")
    else:
        remedy = f"install it, or name it in {VARIABLE}"
    return f"Mitsuba's llvm_ad_rgb needs LLVM {OLDEST} or later, and {found}: {remedy}; the engine mitsuba_scalar does without"


def why_unloadable(path: str | None) -> str:
    """What the loader says of a library that Dr.Jit could not load."""
    try:
        if path:
            ctypes.CDLL(path)
    except OSError as error:
        return f"{path} cannot be loaded ({error})"
    return "Dr.Jit found none"


@contextmanager
def chosen() -> Iterator[None]:
    """Within it Dr.Jit is imported with the library of `find`, and with what it finds itself where there is none."""
    before = os.environ.get(VARIABLE)
    try:
        path = find()
    except Unsupported:
        path = None
    try:
        if path is not None:
            os.environ[VARIABLE] = path
        yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before


@cache
def _system(library_path: str, program_path: str) -> tuple[int, str | None]:
    """Version and path of the newest library that the loader finds: (0, None) without one."""
    libraries = [str(file) for folder in filter(None, library_path.split(":")) for file in Path(folder).glob("libLLVM*.so*")]
    ldconfig = shutil.which("ldconfig", path=f"{program_path}:/sbin:/usr/sbin")
    if ldconfig:
        listed = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
        libraries += [path for _, path in _CACHED.findall(listed)]
    return max(((_version(path), path) for path in libraries), default=(0, None), key=lambda one: one[0])


def _version(path: str) -> int:
    """The major version in a library's name, or in that of the file it is a link to; 0 where there is none."""
    match = _VERSION.match(Path(path).name) or _VERSION.match(Path(path).resolve().name)
    return int(match[1]) if match else 0


def _of_wheel() -> str | None:
    try:
        files = metadata.files(WHEEL) or []
    except metadata.PackageNotFoundError:
        return None
    libraries = (Path(str(file.locate())).resolve() for file in files if _VERSION.fullmatch(file.name.rpartition(".")[0]))
    return next((str(path) for path in libraries if path.is_file()), None)


__all__ = ["OLDEST", "VARIABLE", "WHEEL", "chosen", "find", "lacking", "why_unloadable"]
