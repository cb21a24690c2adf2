"""The process in which things are measured: `main` is run by `engines.processes.child`.

A worker belongs to one engine and one block. It imports the engine once (timed) and then forks a child for every job, so that
a cell finds a fresh process (nothing compiled, loaded or warmed by the cell before it) and imports are paid once. Where forking
is not safe (other systems than Linux, or an engine that started threads on import) it serves one job itself and ends, and the
parent starts another.

A job is a function that its request names, `module:function`: `jobs` has those of this package. Messages: `messages`.

Like `harness.processes` it imports the standard library only, so that the time to import an engine is all its own.
"""

from __future__ import annotations

import gc
import importlib
import json  # noqa: F401 (for messages: the time to import it is not the engine's)
import os
import sys
import threading
from collections.abc import Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

from harness.processes import one_line

if TYPE_CHECKING:
    from harness.measure.messages import Job, Parent


def main(descriptors: Sequence[int], arguments: Sequence[str]) -> None:
    """Imports the engine `arguments[0]` and serves the parent at the socket `descriptors[0]`."""
    (name,) = arguments
    engine, version, code, failure = None, "", "", ""
    start = perf_counter()
    try:
        from engines.registry import engine as engine_of

        engine = engine_of(name)
        version = str(engine.version)
        seconds = perf_counter() - start
        from harness.source_hashes import engine_code

        code = engine_code(engine, name)
    except BaseException as error:
        seconds, failure = 0.0, one_line(error)
    from harness.measure import messages

    parent = messages.Parent(descriptors[0])
    if failure:
        parent.send(messages.Failed(failure))
        os._exit(0)
    # What a cell needs besides, so that children find it.
    import harness.measure.clock
    import harness.measure.jobs  # noqa: F401

    apart = getattr(engine, "own_process", False)  # that process is one cell's, as a fork would be
    forks = hasattr(os, "fork") and sys.platform == "linux" and threads_now() == 1 and not apart
    gc.collect()
    gc.freeze()
    parent.send(messages.Imported(seconds, version, code, forks))
    while forks:
        parent.send(messages.Idle(in_child(engine, parent.receive(messages.Job), parent)))
    serve(engine, parent.receive(messages.Job), parent)
    parent.send(messages.Idle(0))


def threads_now() -> int:
    """Threads of this process, those of native libraries included where the system counts them."""
    try:
        return len(os.listdir("/proc/self/task"))
    except OSError:
        return threading.active_count()


def in_child(engine: Any, job: Job, parent: Parent) -> int:
    """Serves a job in a forked child; the exit status, negative for a signal."""
    from engines.processes.child import die_with_parent

    worker = os.getpid()
    child = os.fork()
    if child == 0:
        try:
            die_with_parent()
            if os.getppid() == worker:  # else it had gone before it was asked for
                serve(engine, job, parent)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def serve(engine: Any, job: Job, parent: Parent) -> None:
    """Runs one job; an exception becomes a message."""
    from harness.measure.messages import Failed

    module, _, function = job.function.partition(":")
    try:
        getattr(importlib.import_module(module), function)(engine, job.request, parent)
    except BaseException as error:  # sys.exit of an engine is a failure, too
        import contextlib
        import traceback

        with contextlib.suppress(OSError):  # where the log cannot grow
            traceback.print_exc()
        parent.send(Failed(one_line(error)))
