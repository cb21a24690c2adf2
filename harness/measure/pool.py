"""The parent's side of worker processes: start one for an engine, ask, wait with a deadline, kill."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, NoReturn, TypeVar

from engines.errors import ConfigError, RaybenchError
from engines.film import BYTES_A_PIXEL
from engines.processes import BadMessage, Closed, Process, records, status_in_words
from engines.temporary import TemporaryFolder, remove_abandoned
from harness.measure import contention, films, memory, messages, tracing
from harness.measure.messages import Answer, End, Failed, Go, Idle, Imported, Job, Point, Prepared, Results, Traced, Unwritten
from harness.measure.requests import CellRequest, ImageRequest, RayRequest, ReferenceRequest, Request
from harness.measure.run_queue import EndedThreads
from harness.processes import worker_environment

if TYPE_CHECKING:
    from engines.film import Film

IMPORT_TIMEOUT_SECONDS = 180.0
FOREVER = math.inf
"""A deadline that never comes."""
T = TypeVar("T")


class WorkerFailed(Exception):
    """A request that failed; the message is the worker's, or says how the process died."""


class ScratchUnwritten(WorkerFailed):
    """A worker could not write its film or its answers, it says."""


class WorkerTimeout(Exception):
    """A request that took too long; its process has been killed."""


class WorkerMessage(NamedTuple):
    """A message of a worker about a cell, and what came with it: the film of a `Point`, the answers of `Traced` rays as
    `tracing.read_answers` returns them."""

    message: Imported | Prepared | Point | Traced | End
    film: Film | None = None
    answers: tracing.Arrays | None = None


class Worker:
    """A process that has imported one engine. Use `ask`, then `receive` until `End`; `kill` at any time. `busy` says that
    the end of a job has not been received.

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
        self._most_bytes = memory.default_limit() if most_bytes is None else most_bytes
        environment = {**worker_environment(allow_imports, code), **({"TMPDIR": str(folder)} if folder else {})}
        with _opened(log) as output:
            try:
                self._process = Process(
                    "harness.measure.worker:main",
                    engine,
                    environment=environment,
                    output=output,
                    dies_with_thread=True,
                    most_bytes=messages.MOST_BYTES,
                )
            except OSError as error:
                raise WorkerFailed(f"no process could be started: {error.strerror or error}") from error
        (self._channel,) = self._process.channels
        self._watch = memory.Watch(self._process.pid)
        self._looked = monotonic()
        self._forks = False
        self.threads: EndedThreads | None = None
        self.usable, self.busy = True, True
        try:
            self.imported = self.receive(monotonic() + IMPORT_TIMEOUT_SECONDS, Imported)
        except WorkerTimeout:
            raise WorkerFailed(f"engine {engine!r}: not imported within {IMPORT_TIMEOUT_SECONDS:g} s") from None
        except BaseException:  # Ctrl-C: no pool knows of this worker yet
            self.kill()
            raise
        self.busy, self._forks = False, self.imported.forks

    def ask(self, request: Job | Go) -> None:
        self.busy = True
        try:
            self._channel.send(pickle.dumps(request))
        except Closed:
            self._died()

    def receive(self, deadline: float, *expected: type[T]) -> T:
        """The next answer, of one of the types `expected`. Raises `WorkerFailed`, or `WorkerTimeout` at `deadline` (of
        `monotonic`)."""
        answer = self._answer(deadline)
        if isinstance(answer, Unwritten):
            self.kill()
            raise ScratchUnwritten(answer.message)
        if isinstance(answer, Failed):
            self._settle(deadline)
            raise WorkerFailed(answer.message)
        if isinstance(answer, Idle):
            self.busy, self.usable = False, self._forks
            raise WorkerFailed(f"the engine's process {status_in_words(answer.status)}")
        if not isinstance(answer, expected):
            self.kill()
            sent, due = records.kind(type(answer)), records.kind(expected[0])
            raise WorkerFailed(f"the engine's process sent a message {sent!r} where {due!r} is expected")
        if isinstance(answer, End):
            self._settle(deadline)
        return answer

    def _answer(self, deadline: float) -> Answer:
        """The next message; a process that writes something else is killed."""

        def pause() -> float:
            self._look_now_and_then()
            if monotonic() >= deadline:
                self.kill()
                raise WorkerTimeout
            return max(0.0, min(self._looked + memory.POLL_SECONDS, deadline) - monotonic())

        try:
            answer = messages.answer_of(self._channel.receive(pause).data)
        except Closed:
            self._died()
        except BadMessage as error:
            self.kill()
            raise WorkerFailed(f"the engine's process was killed: {error}") from None
        self._look_now_and_then()
        return answer

    def _settle(self, deadline: float) -> None:
        """Waits until the child of a finished job has gone: nothing of it may run beside the next cell."""
        self.busy = False
        try:
            self.receive(max(deadline, monotonic() + 5.0), Idle)
        except (WorkerFailed, WorkerTimeout):
            return

    def _look_now_and_then(self) -> None:
        """Sees what threads wait, and kills a process that holds too much: where the system does it, it may choose another."""
        if monotonic() < self._looked + memory.POLL_SECONDS:
            return
        self._looked = monotonic()
        if self.threads is not None:
            self.threads.look(self._watch.pids)
        held = self._watch.resident(self._forks)
        if held > self._most_bytes:
            self.kill()
            raise WorkerFailed(f"memory: {memory.words(held)} of {memory.words(self._most_bytes)}")

    def ended_waits(self, answer: Point | Traced) -> float:
        """Seconds that threads waited in a timed call and could not be counted after it; see `EndedThreads`."""
        window = answer.began, answer.ended
        return 0.0 if self.threads is None else self.threads.waited(self._watch.pids, *window, answer.alive)

    def _died(self) -> NoReturn:
        ending = self._process.ended()
        self.kill()
        raise WorkerFailed(f"the worker {ending}")

    def kill(self) -> None:
        """Ends the process and its children at once."""
        self.usable = False
        if not self._process.reaped:
            self._watch.kill()
        self._process.kill()


def _opened(log: Path) -> BinaryIO:
    """The file that workers print to. Raises `ConfigError`."""
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        return log.open("ab")
    except OSError as error:
        raise ConfigError(f"{log}: cannot be written: {error.strerror}") from error


class Pool:
    """One worker an engine, at most one of them busy; the others wait for messages and cost nothing."""

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

    def cell(
        self, engine: str, request: CellRequest | RayRequest, timeout_seconds: float, enough: Callable[[], bool] = lambda: False
    ) -> Generator[WorkerMessage]:
        """The messages of a worker about a cell, from its import to its end; the caller's time in between is not counted. Once
        the caller has `enough` a film is the last one.

        Raises `WorkerFailed` and `WorkerTimeout`. A worker that is left before its end is killed. What disturbed the cell is
        judged here: `machine` of its `End`.
        """
        worker = self.worker(engine)
        yield WorkerMessage(worker.imported)
        deadline = monotonic() + timeout_seconds
        traces = isinstance(request, RayRequest)
        worker.ask(Job(f"harness.measure.jobs:{'trace' if traces else 'cell'}", self._complete(request)))
        expected: tuple[type[Prepared | Point | Traced | End], ...] = (Prepared,)
        worker.threads, waited = EndedThreads(), 0.0
        try:
            while True:
                answer = self._receive(worker, request, deadline, *expected)
                began, film, answers = monotonic(), None, None
                if isinstance(answer, (Point, Traced)):
                    waited += worker.ended_waits(answer)
                if isinstance(answer, Point) and isinstance(request, CellRequest):
                    film = self._film(worker, request, answer.spp, answer.overshoots)
                if isinstance(answer, Traced) and isinstance(request, RayRequest):
                    answers = self._answers(worker, request)
                if isinstance(answer, End):
                    machine = contention.judged(answer.machine, request.settings.threads, waited)
                    yield WorkerMessage(answer._replace(machine=machine))
                    return
                yield WorkerMessage(answer, film, answers)
                deadline += monotonic() - began
                expected = (Point, End) if not traces else (End,) if isinstance(answer, Traced) else (Traced,)
                if film is not None:
                    worker.ask(Go(enough()))
        except GeneratorExit:
            worker.kill()
            raise
        finally:
            worker.threads = None

    def replicates(self, engine: str, request: ReferenceRequest, seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """A reference's image under each seed, in order, with the seconds it took. Raises `WorkerFailed`."""
        worker = self.worker(engine)
        worker.ask(Job("harness.measure.jobs:reference", self._complete(request._replace(seeds=tuple(seeds)))))
        try:
            for _ in seeds:
                answer = self._receive(worker, request, FOREVER, Point)
                yield self._film(worker, request, request.spp, answer.overshoots), answer.seconds
                worker.ask(Go())
        except GeneratorExit:
            worker.kill()
            raise
        worker.receive(FOREVER, End)

    def run(self, engine: str, job: Job, timeout_seconds: float) -> Sequence[Any]:
        """The results of a job of another room, which sends `Results` and `End`. Raises `WorkerFailed` and `WorkerTimeout`."""
        worker = self.worker(engine)
        deadline = monotonic() + timeout_seconds
        worker.ask(job)
        found = worker.receive(deadline, Results).results
        worker.receive(deadline, End)
        return found

    def _complete(self, request: Request) -> Request:
        """A request with what this pool adds to it."""
        return request._replace(allow_imports=self._allow_imports, scratch=str(self.scratch))

    def _receive(self, worker: Worker, request: Request, deadline: float, *expected: type[T]) -> T:
        """The worker's next answer. Raises `ConfigError` where a film or answers cannot be written, which is no failure of the
        cell, once this process has tried as well: an engine can send any message."""
        try:
            return worker.receive(deadline, *expected)
        except ScratchUnwritten as error:
            if isinstance(request, RayRequest):
                what, size = "answers", tracing.bytes_left(request)
            else:
                what, size = "film", request.settings.width * request.settings.height * BYTES_A_PIXEL
            try:
                with self.scratch.open("wb") as file:
                    for _ in range(0, size, 1 << 20):
                        file.write(bytes(1 << 20))
            except OSError:
                raise ConfigError(str(error)) from None
            raise WorkerFailed(f"its {what} could not be written there, though this process can: {error}") from None

    def _film(self, worker: Worker, request: ImageRequest, spp: int, overshoots: bool) -> Film:
        """The film of `spp` samples that a worker has left; raises `WorkerFailed` where it is none."""
        settings = request.settings
        try:
            return films.take(self.scratch, settings.width, settings.height, spp, overshoots)
        except RaybenchError as error:
            worker.kill()
            raise WorkerFailed(str(error)) from error

    def _answers(self, worker: Worker, request: RayRequest) -> tracing.Arrays:
        """The answers that a worker has left; raises `WorkerFailed` where they are none."""
        try:
            return tracing.read_answers(self.scratch, request)
        except RaybenchError as error:
            worker.kill()
            raise WorkerFailed(str(error)) from error

    def renew(self) -> None:
        """Ends all workers: the next block begins with fresh ones."""
        for worker in self._workers.values():
            worker.kill()
        self._workers.clear()
