"""A cold start uses two cores: what is not on disk yet is compiled by this process and by a fork of it.

Numba compiles under one lock, and mostly in Python, so threads gain nothing. The fork keeps what it compiles on disk and ends;
this process loads it from there. Where the fork fails, this process compiles everything itself.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from engines.kernels.compile import code_cache

Job = Callable[[], Any]

FEWEST = 3
"""Jobs from which on a second process is worth its start."""
PATIENCE = 30.0
"""Seconds that this process waits for the other one after it has done its own share."""


def compile_jobs(jobs: Sequence[Job]) -> None:
    """Calls each job, which compiles or loads code, in this process or in a second one; costly jobs should come first.

    A job that was done by the second process has put its code on disk, and loads it when it is called again. What a job raises
    here is raised.
    """
    if not _second_core_is_free():
        return
    missing = [job for job in jobs if not _is_on_disk(job)]
    if len(missing) < FEWEST:
        return
    queue, end = os.pipe()  # a byte is the number of a job; who reads it does it
    os.write(end, bytes(range(len(missing))))
    os.close(end)
    with warnings.catch_warnings():  # of threads that a library has started: the fork compiles, and nothing else
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        with suppress(BaseException):
            _work(missing, queue)
        os._exit(0)
    patience = 0.0
    try:
        _work(missing, queue)
        patience = PATIENCE
    finally:
        os.close(queue)
        _end(child, patience)


def _second_core_is_free() -> bool:
    """Whether a fork can help: on Linux, with two cores, from a process without other Python threads, whose locks it would
    inherit."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and threading.active_count() == 1


def _is_on_disk(job: Job) -> bool:
    with code_cache.loading_only():
        try:
            job()
        except code_cache.NotOnDisk:
            return False
    return True


def _work(jobs: Sequence[Job], queue: int) -> None:
    while number := os.read(queue, 1):
        jobs[number[0]]()


def _end(child: int, patience: float) -> None:
    """Waits for the other process, and ends it where that takes too long."""
    until = time.monotonic() + patience
    with suppress(ChildProcessError):  # someone else has waited for it
        while os.waitpid(child, os.WNOHANG)[0] == 0:
            if time.monotonic() > until:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return
            time.sleep(0.002)
