"""Mitsuba itself: whether it is installed, which variant is expected, and how many threads it takes.

Variant and threads are state of the whole process, so that calls into Mitsuba run within `active`.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import util
from typing import Any

from engines.errors import Unsupported
from engines.packages import install_extra
from engines.peers.mitsuba import llvm

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"
MOST_SHOWN = 300
"""Characters of a message of Mitsuba's."""
_NOISE = re.compile(r"\[\w+(\.\w+:\d+)?\] |(At|While loading) dictionary node \"root\": ")
_in_use = threading.RLock()


def _renew_lock() -> None:
    global _in_use
    _in_use = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_renew_lock)


def lacking(variant: str) -> str | None:
    """One sentence on what has to be installed for `variant`, or None."""
    if util.find_spec("mitsuba") is None or util.find_spec("drjit") is None:
        return f"Mitsuba 3 is not installed: {install_extra('mitsuba')}"
    try:
        path = llvm.find() if variant == LLVM else None
        drjit = _drjit()
    except ImportError as error:
        return f"Mitsuba 3 cannot be loaded: {error}"
    except Unsupported as error:
        return str(error)
    if variant != LLVM:
        return None
    if not drjit.has_backend(drjit.JitBackend.LLVM):
        return llvm.lacking(llvm.why_unloadable(path))
    loaded = drjit.detail.llvm_version()
    return llvm.lacking(f"Dr.Jit has loaded {'.'.join(map(str, loaded))}") if loaded[0] < llvm.OLDEST else None


def _drjit() -> Any:
    """Dr.Jit, which loads LLVM when it is imported, before Mitsuba. Raises `ImportError`."""
    if "drjit" not in sys.modules:
        with _in_use, llvm.chosen():
            importlib.import_module("drjit")
    return sys.modules["drjit"]


def modules() -> tuple[Any, Any]:
    """The modules `mitsuba` and `drjit`. Raises `ImportError`."""
    drjit = _drjit()
    return importlib.import_module("mitsuba"), drjit


def activate(variant: str, threads: int) -> tuple[Any, Any]:
    """The modules `mitsuba` and `drjit`, the one set to `variant`, the other to that number of threads."""
    mitsuba, drjit = modules()
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


def one_line(problem: BaseException) -> str:
    """The message of an error of Mitsuba's without places in its own code, in one line of at most `MOST_SHOWN` characters."""
    text = " ".join(_NOISE.sub("", str(problem)).split())
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
