"""The parent's side of worker processes: start one for an engine, ask, wait with a deadline, kill."""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

from engines.errors import ConfigError

if TYPE_CHECKING:
    from engines.film import Film

IMPORT_TIMEOUT_SECONDS = 180.0
FOREVER = math.inf
"""A deadline that never comes."""
THREAD_POOLS = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "BLIS_NUM_THREADS",
)  # fmt: skip
"""Set to 1 in workers: an engine's threads are the cell's `threads`, not those of a library below it."""


class WorkerFailed(Exception):
    """A request that failed; the message is the worker's, or says how the process died."""


class WorkerTimeout(Exception):
    """A request that took too long; its process has been killed."""


class Heard(NamedTuple):
    """A message of a worker, and the film that came with it."""

    message: dict[str, Any]
    film: Film | None = None


class Worker:
    """A process that has imported one engine. Use `ask`, then `receive` until "end"; `kill` at any time."""

    def __init__(self, engine: str, allow_imports: bool, log: Path) -> None:
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            self._log = log.open("ab")
        except OSError as error:
            raise ConfigError(f"{log}: cannot be written: {error.strerror}") from error
        self._process = subprocess.Popen(
            [sys.executable, "-m", "harness.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
            env=environment(allow_imports), start_new_session=True, bufsize=0,
        )  # fmt: skip
        self._pending = b""
        self.usable = True
        self.ask({"do": "import", "engine": engine})
        try:
            answer = self.receive(monotonic() + IMPORT_TIMEOUT_SECONDS)
        except WorkerTimeout:
            raise WorkerFailed(f"engine {engine!r}: not imported within {IMPORT_TIMEOUT_SECONDS:g} s") from None
        self.import_seconds: float = answer["seconds"]
        self.version: str = answer["version"]
        self._forks: bool = answer["forks"]

    def ask(self, request: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
        except BrokenPipeError:
            self._died()

    def receive(self, deadline: float) -> dict[str, Any]:
        """The next answer. Raises `WorkerFailed`, or `WorkerTimeout` at `deadline` (of `monotonic`).

        `ConfigError`: the disk is full, which is no failure of the cell.
        """
        while b"\n" not in self._pending:
            self._read(deadline)
        line, _, self._pending = self._pending.partition(b"\n")
        answer = json.loads(line)
        if answer["did"] == "unwritten":
            self.kill()
            raise ConfigError(answer["message"])
        if answer["did"] == "failed":
            self._settle(deadline)
            raise WorkerFailed(answer["message"])
        if answer["did"] == "idle":
            self.usable = self._forks
            status = answer["status"]
            reason = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
            raise WorkerFailed(f"the engine's process {reason}")
        if answer["did"] == "end":
            self._settle(deadline)
        return answer

    def _settle(self, deadline: float) -> None:
        """Waits until the child of a finished request has gone: nothing of it may run beside the next cell."""
        try:
            self.receive(max(deadline, monotonic() + 5.0))
        except WorkerFailed:
            return
        except WorkerTimeout:
            return
        self.kill()

    def _read(self, deadline: float) -> None:
        assert self._process.stdout is not None
        handle = self._process.stdout.fileno()
        wait = None if deadline == FOREVER else max(0.0, deadline - monotonic())
        ready = select.select([handle], [], [], wait)[0]
        if not ready:
            self.kill()
            raise WorkerTimeout
        data = os.read(handle, 65536)
        if not data:
            self._died()
        self._pending += data

    def _died(self) -> None:
        status = self._process.wait()
        self.kill()
        reason = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        raise WorkerFailed(f"the worker {reason}")

    def kill(self) -> None:
        """Ends the process and its children at once."""
        self.usable = False
        # Until it has been waited for, the process keeps its number, and the group is surely ours.
        if self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._log):
            if stream is not None:
                stream.close()


class Pool:
    """One worker an engine, at most one of them busy; the others wait on their pipes and cost nothing."""

    def __init__(self, allow_imports: bool, log: Path) -> None:
        self._allow_imports = allow_imports
        self._workers: dict[str, Worker] = {}
        self._folder = tempfile.TemporaryDirectory(prefix="raybench-")
        self._log = log
        self.scratch = Path(self._folder.name) / "film.npz"

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self.renew()
        self._folder.cleanup()

    def worker(self, engine: str) -> Worker:
        """A worker of that engine that is free; raises `WorkerFailed` when the engine cannot be imported."""
        if engine in self._workers and not self._workers[engine].usable:
            self._workers.pop(engine).kill()
        if engine not in self._workers:
            self._workers[engine] = Worker(engine, self._allow_imports, self._log)
        return self._workers[engine]

    def cell(self, engine: str, request: Mapping[str, Any], timeout_seconds: float) -> Iterator[Heard]:
        """What a worker tells of a cell, from its import to its end; the caller's time in between is not counted.

        Raises `WorkerFailed`, or `WorkerTimeout` when the cell has been killed at its timeout.
        """
        worker = self.worker(engine)
        yield Heard({"did": "import", "seconds": worker.import_seconds, "version": worker.version})
        deadline = monotonic() + timeout_seconds
        worker.ask({"do": "cell", **request, "allow_imports": self._allow_imports, "scratch": str(self.scratch)})
        did = ""
        while did != "end":
            answer = worker.receive(deadline)
            did, began = answer["did"], monotonic()
            yield Heard(answer, film_of(self.scratch) if did == "point" else None)
            deadline += monotonic() - began
            if did == "point":
                worker.ask({"do": "go"})

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """A reference's image under each seed, in order, with the seconds it took. Raises `WorkerFailed`."""
        worker = self.worker(engine)
        told = {"allow_imports": self._allow_imports, "scratch": str(self.scratch), "seeds": list(seeds)}
        worker.ask({"do": "reference", **request, **told})
        for _ in seeds:
            seconds = worker.receive(FOREVER)["seconds"]
            yield film_of(self.scratch), seconds
            worker.ask({"do": "go"})
        worker.receive(FOREVER)

    def renew(self) -> None:
        """Ends all workers: the next block begins with fresh ones."""
        for worker in self._workers.values():
            worker.kill()
        self._workers.clear()


def environment(allow_imports: bool) -> dict[str, str]:
    """The environment of workers: this checkout's packages first, no hidden threads, vectors of the full width."""
    root = str(Path(__file__).resolve().parent.parent)
    paths = [root, *([os.getcwd()] if allow_imports else []), os.environ.get("PYTHONPATH", "")]
    changes: dict[str, str] = dict.fromkeys(THREAD_POOLS, "1")
    # With the generic processor model and the host's features Numba's vectors are 512 bits wide where they can be.
    changes["NUMBA_CPU_NAME"] = os.environ.get("NUMBA_CPU_NAME", "")
    return {**os.environ, **changes, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "PYTHONSAFEPATH": "1"}


def film_of(path: Path) -> Film:
    """The film that a worker left."""
    import numpy as np

    from engines.film import Film

    try:
        with np.load(path) as arrays:
            height, width = arrays["counts"].shape
            film = Film(width, height)
            film.sums, film.squares, film.even_sums = arrays["sums"], arrays["squares"], arrays["even_sums"]
            film.counts, film.bad_samples = arrays["counts"], int(arrays["bad_samples"])
        for array in (film.sums, film.squares, film.even_sums):
            if array.shape != (height, width, 3) or array.dtype.kind != "f" or film.counts.dtype.kind not in "iu":
                raise ValueError(f"{array.shape} {array.dtype} beside counts {film.counts.shape} {film.counts.dtype}")
    except (OSError, KeyError, ValueError, TypeError, EOFError, OverflowError, MemoryError, BadZipFile) as error:
        raise ConfigError(f"{path}: the film cannot be read: {error}") from error
    return film
