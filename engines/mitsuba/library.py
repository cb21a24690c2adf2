"""Mitsuba itself: whether it is installed, which variant is wanted, and how many threads it takes.

Variant and threads are state of the whole process, so that calls into Mitsuba run within `active`.
"""

from __future__ import annotations

import importlib
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata, util
from typing import Any

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"
OLDEST_LLVM = 17
"""Dr.Jit loads older ones too, some of which end the process while they compile ("Cannot select ... fminimum")."""
_in_use = threading.RLock()


def _renew_lock() -> None:
    global _in_use
    _in_use = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_renew_lock)


def lacking(variant: str) -> str | None:
    """One sentence on what has to be installed for `variant`, or None."""
    if util.find_spec("mitsuba") is None or util.find_spec("drjit") is None:
        return "Mitsuba 3 is not installed: pip install 'raybench[mitsuba]'"
    if variant == LLVM:
        drjit = importlib.import_module("drjit")
        usable = drjit.has_backend(drjit.JitBackend.LLVM)
        found = drjit.detail.llvm_version() if usable else (0,)
        if not usable or found[0] < OLDEST_LLVM:
            return (
                f"Mitsuba's llvm_ad_rgb needs a system libLLVM {OLDEST_LLVM} or later, and "
                + (f"Dr.Jit found {'.'.join(map(str, found))}" if usable else "none was found")
                + ": install it, or name it in DRJIT_LIBLLVM_PATH; the engine mitsuba_scalar does without"
            )
    return None


def version() -> str:
    """The version of the package, without importing it."""
    try:
        return metadata.version("mitsuba")
    except metadata.PackageNotFoundError:
        return "none"


def activate(variant: str, threads: int) -> tuple[Any, Any]:
    """The modules `mitsuba` and `drjit`, the one set to `variant`, the other to that number of threads."""
    mitsuba, drjit = importlib.import_module("mitsuba"), importlib.import_module("drjit")
    if mitsuba.variant() != variant:
        mitsuba.set_variant(variant)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
    if drjit.thread_count() != threads:
        drjit.set_thread_count(threads)
    return mitsuba, drjit


@contextmanager
def active(variant: str, threads: int) -> Iterator[None]:
    """`activate`, and no other thread's calls before the end: they wait, whichever renderer they are of."""
    with _in_use:
        activate(variant, threads)
        yield
