"""What every process that the harness starts has in common: its environment, its errors as one line.

It imports the standard library only: workers import it before they time the import of their engine.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

MOST_CHARACTERS = 2000
"""Of an exception's message."""
THREAD_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "BLIS_NUM_THREADS")
"""Set to 1 in workers: an engine's threads are the cell's `threads`, not those of a library below it."""


def allow_here(allow_imports: bool, folder: Path | None = None) -> None:
    """Code that files name may lie in the working directory; first it is looked for in `folder`, that of an experiment."""
    places = [str(place.absolute()) for place in (Path.cwd(), folder) if place is not None]
    for place in places if allow_imports else ():
        sys.path[:] = [place, *(other for other in sys.path if other != place)]


def worker_environment(allow_imports: bool, code: Path | None = None) -> dict[str, str]:
    """The environment of workers: this checkout's packages first, no hidden threads.

    With `allow_imports` modules are found where this process finds them, and before that in the folder `code`.
    """
    from engines.imports import users_folders

    more = [*([str(code.absolute())] if code else []), *users_folders(), os.getcwd()] if allow_imports else []
    changes: dict[str, str] = dict.fromkeys(THREAD_POOLS, "1")
    return {**os.environ, **changes, "PYTHONPATH": python_path(more)}


def python_path(folders: Sequence[str]) -> str:
    """The variable PYTHONPATH for a process: this checkout's packages first, then modules in the folders."""
    root = str(Path(__file__).resolve().parent.parent)
    return os.pathsep.join(filter(None, [root, *folders, os.environ.get("PYTHONPATH", "")]))


def one_line(error: BaseException) -> str:
    """An exception as one line: our own errors speak for themselves, others are named."""
    from engines.errors import RaybenchError

    try:
        text = " ".join(str(error).split())[:MOST_CHARACTERS]
    except Exception:
        text = "(its message cannot be read)"
    return text if isinstance(error, RaybenchError) else f"{type(error).__name__}: {text}"
