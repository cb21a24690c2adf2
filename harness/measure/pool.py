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
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple

from engines.errors import ConfigError, RaybenchError
from engines.film import BYTES_A_PIXEL
from engines.temporary import TemporaryFolder, remove_abandoned
from harness.measure import contention, memory, protocol
from harness.measure.run_queue import EndedThreads
from harness.processes import worker_environment

if TYPE_CHECKING:
    from engines.film import Film

IMPORT_TIMEOUT_SECONDS = 180.0
LAST_SECONDS = 5.0
"""What a process has left to end in, once it has closed its pipe."""
FOREVER = math.inf
"""A deadline that never comes."""


class WorkerFailed(Exception):
    """A request that failed; the message is the worker's, or says how the process died."""


class FilmUnwritten(WorkerFailed):
    """A worker could not write its film, it says."""


class WorkerTimeout(Exception):
    """A request that took too long; its process has been killed."""


class WorkerMessage(NamedTuple):
    """A message of a worker, and the film that came with it."""

    message: dict[str, Any]
    film: Film | None = None


class Worker:
    """A process that has imported one engine. Use `ask`, then `receive` until "end"; `kill` at any time. `busy` says that
    the end of a request has not been received.

    It is killed when it and its children together hold more than `most_bytes` of memory. `threads` are looked at while it is
    waited for, where they are expected.
    """

    def __init__(
        self,
        engine: str,
        allow_imports: bool,
        log: Path,
        most_bytes: int | None = None,
        folder: Path | None = None,
        code: Path | None = None,
    ) -> None:
        """`folder` is where the process and what it starts keep temporary files, `code` where code that files name is looked
        for first."""
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            self._log = log.open("ab")
        except OSError as error:
            raise ConfigError(f"{log}: cannot be written: {error.strerror}") from error
        self._most_bytes = memory.default_limit() if most_bytes is None else most_bytes
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "harness.measure.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                start_new_session=True,
                bufsize=0,
                env={**worker_environment(allow_imports, code), **({"TMPDIR": str(folder)} if folder else {})},
            )
        except OSError as error:
            self._log.close()
            raise WorkerFailed(f"no process could be started: {error.strerror or error}") from error
        self._watch = memory.Watch(self._process.pid)
        self._looked = monotonic()
        self._pending = b""
        self._forks = False
        self.threads: EndedThreads | None = None
        self.usable, self.busy = True, False
        self.ask({"do": "import", "engine": engine})
        try:
            answer = self.receive(monotonic() + IMPORT_TIMEOUT_SECONDS, "import")
        except WorkerTimeout:
            raise WorkerFailed(f"engine {engine!r}: not imported within {IMPORT_TIMEOUT_SECONDS:g} s") from None
        self.busy = False
        self.import_seconds: float = answer["seconds"]
        self.version: str = answer["version"]
        self.code: str = answer["code"]
        self._forks = answer["forks"]

    def ask(self, request: dict[str, Any]) -> None:
        self.busy = True
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
        except BrokenPipeError:
            self._died()

    def receive(self, deadline: float, *wanted: str) -> dict[str, Any]:
        """The next answer, of one of the kinds `wanted`. Raises `WorkerFailed`, or `WorkerTimeout` at `deadline` (of
        `monotonic`)."""
        answer = self._message(deadline)
        if answer["did"] == "unwritten":
            self.kill()
            raise FilmUnwritten(answer["message"])
        if wanted and answer["did"] not in (*wanted, "failed", "idle"):
            self.kill()
            raise WorkerFailed(f"the engine's process sent a message {answer['did']!r} where {wanted[0]!r} is expected")
        if answer["did"] == "failed":
            self._settle(deadline)
            raise WorkerFailed(answer["message"])
        if answer["did"] == "idle":
            self.busy = False
            self.usable = self._forks
            status = answer["status"]
            reason = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
            raise WorkerFailed(f"the engine's process {reason}")
        if answer["did"] == "end":
            self._settle(deadline)
        return answer

    def _message(self, deadline: float) -> dict[str, Any]:
        """The next line, as a message; a process that writes something else is killed."""
        while b"\n" not in self._pending and len(self._pending) <= protocol.MOST_BYTES:
            self._read(deadline)
        line, _, self._pending = self._pending.partition(b"\n")
        try:
            if len(line) > protocol.MOST_BYTES:
                raise protocol.BadMessage(
                    f"it sent a message of more than {memory.words(protocol.MOST_BYTES)}: {protocol.excerpt(line)}"
                )
            return protocol.parsed(line)
        except protocol.BadMessage as error:
            self.kill()
            raise WorkerFailed(f"the engine's process was killed: {error}") from None

    def _settle(self, deadline: float) -> None:
        """Waits until the child of a finished request has gone: nothing of it may run beside the next cell."""
        self.busy = False
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
        while not select.select([handle], [], [], min(memory.POLL_SECONDS, max(0.0, deadline - monotonic())))[0]:
            self._look()
            if monotonic() >= deadline:
                self.kill()
                raise WorkerTimeout
        if monotonic() > self._looked + memory.POLL_SECONDS:
            self._look()
        data = os.read(handle, 65536)
        if not data:
            self._died()
        self._pending += data

    def _look(self) -> None:
        """Sees what threads wait, and kills a process that holds too much: where the system does it, it may choose another."""
        self._looked = monotonic()
        if self.threads is not None:
            self.threads.look(self._watch.pids)
        held = self._watch.resident(self._forks)
        if held > self._most_bytes:
            self.kill()
            raise WorkerFailed(f"memory: {memory.words(held)} of {memory.words(self._most_bytes)}")

    def ended_waits(self, window: Sequence[float], alive: Sequence[int]) -> float:
        """Seconds that threads waited in a timed call and could not be counted after it; see `EndedThreads`."""
        return 0.0 if self.threads is None else self.threads.waited(self._watch.pids, window[0], window[1], alive)

    def _died(self) -> None:
        # A process that has closed its end of the pipe may still run.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=LAST_SECONDS)
        status = self._process.returncode
        self.kill()
        if status is None:
            raise WorkerFailed("the worker closed its pipe and went on: it was killed")
        reason = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        raise WorkerFailed(f"the worker {reason}")

    def kill(self) -> None:
        """Ends the process and its children at once."""
        self.usable = False
        if self._process.returncode is None:
            self._watch.kill()
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

    def __init__(self, allow_imports: bool, log: Path, most_bytes: int | None = None, code: Path | None = None) -> None:
        """`most_bytes` of memory are allowed to a worker and its children; None: a share of the machine's. `code` is the folder
        where code that files name is looked for first."""
        remove_abandoned()
        self._allow_imports, self._most_bytes, self._code = allow_imports, most_bytes, code
        self._workers: dict[str, Worker] = {}
        self._folder = TemporaryFolder()
        self._log = log
        self.scratch = Path(self._folder.name) / "film.npz"
        self._temporary = Path(self._folder.name) / "workers"
        """What killed workers leave in their temporary folder is removed with the pool's."""
        self._temporary.mkdir()

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self.renew()
        self._folder.cleanup()

    def worker(self, engine: str) -> Worker:
        """A worker of that engine that is free; raises `WorkerFailed` when the engine cannot be imported."""
        if engine in self._workers and (self._workers[engine].busy or not self._workers[engine].usable):
            self._workers.pop(engine).kill()
        if engine not in self._workers:
            limits = self._most_bytes, self._temporary, self._code
            self._workers[engine] = Worker(engine, self._allow_imports, self._log, *limits)
        return self._workers[engine]

    def cell(self, engine: str, request: Mapping[str, Any], timeout_seconds: float) -> Generator[WorkerMessage]:
        """The messages of a worker about a cell, from its import to its end; the caller's time in between is not counted.

        Raises `WorkerFailed` and `WorkerTimeout`. A worker that is left before its end is killed. What disturbed the cell is
        judged here: `machine` of its "end".
        """
        worker = self.worker(engine)
        imported = {"seconds": worker.import_seconds, "version": worker.version, "code": worker.code}
        yield WorkerMessage({"did": "import", **imported})
        deadline = monotonic() + timeout_seconds
        worker.ask({"do": "cell", **request, "allow_imports": self._allow_imports, "scratch": str(self.scratch)})
        did, kinds = "", ("prepared",)
        worker.threads, waited = EndedThreads(), 0.0
        try:
            while did != "end":
                answer = self._receive(worker, request, deadline, *kinds)
                did, began = answer["did"], monotonic()
                if did == "point":
                    waited += worker.ended_waits(answer.pop("window", (0.0, 0.0)), answer.pop("alive", []))
                if did == "end":
                    threads = request["settings"]["threads"]
                    answer["machine"] = contention.judged(answer.get("machine", {}), threads, waited)
                yield WorkerMessage(answer, self._film(worker, request, answer) if did == "point" else None)
                deadline += monotonic() - began
                kinds = ("point", "end")
                if did == "point":
                    worker.ask({"do": "go"})
        except GeneratorExit:
            worker.kill()
            raise
        finally:
            worker.threads = None

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """A reference's image under each seed, in order, with the seconds it took. Raises `WorkerFailed`."""
        worker = self.worker(engine)
        options = {"allow_imports": self._allow_imports, "scratch": str(self.scratch), "seeds": list(seeds)}
        worker.ask({"do": "reference", **request, **options})
        try:
            for _ in seeds:
                answer = self._receive(worker, request, FOREVER, "point")
                yield self._film(worker, request, {**answer, "spp": request["spp"]}), answer["seconds"]
                worker.ask({"do": "go"})
        except GeneratorExit:
            worker.kill()
            raise
        worker.receive(FOREVER, "end")

    def trace(self, engine: str, request: Mapping[str, Any], timeout_seconds: float) -> dict[str, Any]:
        """What a worker says of a set of rays that it has traced: its version, phases, `seconds` of `passes`, what disturbed
        these (`machine`) and its `answers`. Raises `WorkerFailed` and `WorkerTimeout`."""
        from harness.measure.tracing import read_answers

        worker = self.worker(engine)
        worker.threads = EndedThreads()
        deadline = monotonic() + timeout_seconds
        options = {"allow_imports": self._allow_imports, "answers": str(self.scratch)}
        try:
            worker.ask({"do": "trace", **request, **options})
            found = worker.receive(deadline, "prepared") | worker.receive(deadline, "traced")
            waited = worker.ended_waits(found.pop("window", (0.0, 0.0)), found.pop("alive", []))
            end = worker.receive(deadline, "end")
            machine = contention.judged(end.get("machine", {}), request["threads"], waited)
            return {**found, "version": worker.version, "machine": machine, "answers": read_answers(self.scratch, request)}
        except RaybenchError as error:
            worker.kill()
            raise WorkerFailed(str(error)) from error
        finally:
            worker.threads = None

    def _receive(self, worker: Worker, request: Mapping[str, Any], deadline: float, *kinds: str) -> dict[str, Any]:
        """The worker's next answer. Raises `ConfigError` where a film cannot be written, which is no failure of the cell,
        once this process has tried as well: an engine can send any message."""
        try:
            return worker.receive(deadline, *kinds)
        except FilmUnwritten as error:
            size = request["settings"]["width"] * request["settings"]["height"] * BYTES_A_PIXEL
            try:
                with self.scratch.open("wb") as file:
                    for _ in range(0, size, 1 << 20):
                        file.write(bytes(1 << 20))
            except OSError:
                raise ConfigError(str(error)) from None
            raise WorkerFailed(f"its film could not be written there, though this process can: {error}") from None

    def _film(self, worker: Worker, request: Mapping[str, Any], answer: Mapping[str, Any]) -> Film:
        """The film that a worker has left and announced by `answer`; raises `WorkerFailed` where it is none."""
        from harness.measure.films import take

        settings = request["settings"]
        try:
            return take(self.scratch, settings["width"], settings["height"], answer["spp"], answer.get("overshoots") is True)
        except RaybenchError as error:
            worker.kill()
            raise WorkerFailed(str(error)) from error

    def renew(self) -> None:
        """Ends all workers: the next block begins with fresh ones."""
        for worker in self._workers.values():
            worker.kill()
        self._workers.clear()
