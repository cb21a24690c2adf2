"""Mitsuba itself: whether it is installed, which variant is wanted, and how many threads it takes.

Variant and threads are state of the whole process, so that every call into Mitsuba begins with `activate`.
"""

from __future__ import annotations

import importlib
from importlib import metadata, util
from typing import Any

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"


def lacking(variant: str) -> str | None:
    """One sentence on what has to be installed for `variant`, or None."""
    if util.find_spec("mitsuba") is None or util.find_spec("drjit") is None:
        return "Mitsuba 3 is not installed: pip install 'raybench[mitsuba]'"
    if variant == LLVM:
        drjit = importlib.import_module("drjit")
        if not drjit.has_backend(drjit.JitBackend.LLVM):
            return (
                "Mitsuba's llvm_ad_rgb needs a system libLLVM, none of a usable version was found: install LLVM 17 or "
                "later, or name it in DRJIT_LIBLLVM_PATH; the engine mitsuba_scalar does without"
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
