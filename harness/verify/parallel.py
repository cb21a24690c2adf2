"""The suite in worker processes: each runs one job after another, and a process that dies is a failed check.

A job is one section of cases for one engine in one precision. Processes are spawned, not forked, because engines start
threads. A process keeps what an engine has compiled or loaded for its next jobs. The parent imports no engine: worker
processes list what an engine has, too, so no native library can crash the parent after the results are known.
"""

from __future__ import annotations

import multiprocessing
import signal
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from multiprocessing.connection import Connection, wait
from time import perf_counter
from types import SimpleNamespace
from typing import Any, NamedTuple

from engines import registry
from engines.errors import RaybenchError
from harness.check_results import CheckResult
from harness.processes import die_with_parent
from harness.verify.case import Case
from harness.verify.subject import Skipped, Subject, accelerator_names, precisions
from harness.verify.suite import CASES, failure, run_case
from harness.verify.tolerances import tracing_precision

SPAWN = multiprocessing.get_context("spawn")


_engine = cache(registry.engine)


class EngineInfo(NamedTuple):
    """What a worker process reports of an engine. `spec` is the name that imports it.

    `precisions`: (setting, tracing precision) pairs. `problem`: why the engine cannot be loaded. `refusal`: why it renders
    nothing at all.
    """

    spec: str
    name: str = ""
    version: str = ""
    precisions: tuple[tuple[str, str], ...] = ()
    accelerators: tuple[str, ...] = ()
    problem: str = ""
    refusal: str = ""


class Job(NamedTuple):
    """The cases of a section for one engine and precision; `checks`: (case id, accelerator) in the order of the results."""

    engine: EngineInfo
    precision: str
    tracing: str
    section: str
    quick: bool
    checks: tuple[tuple[str, str], ...]

    @property
    def description(self) -> str:
        return f"{self.engine.spec} {self.precision} {self.section}"

    def subject(self, accelerator: str) -> Subject:
        return Subject(_engine(self.engine.spec), self.precision, accelerator, self.quick)

    def subject_without_engine(self, accelerator: str) -> Subject:
        """A subject that has the engine's name and version only: for the result of a process that died."""
        name, version = self.engine.name, self.engine.version
        engine: Any = SimpleNamespace(name=name, version=version, tracing_precision=self.tracing)
        return Subject(engine, self.precision, accelerator, self.quick)


@dataclass
class RunningJob:
    """A job in progress: `results` has one list per finished check."""

    number: int
    job: Job
    results: list[list[CheckResult]] = field(default_factory=list)
    since: float = 0.0


class FinishedJob(NamedTuple):
    """`number`: the job's index among all; `seconds` from its begin to its end."""

    number: int
    job: Job
    results: list[CheckResult]
    seconds: float


def describe_engines(specs: Sequence[str]) -> list[EngineInfo]:
    """What these engines have, each reported by a process of its own; one that dies or fails has a `problem`."""
    workers = [_Worker() for _ in specs]
    try:
        for worker, spec in zip(workers, specs, strict=True):
            worker.pipe.send(spec)
        return [worker.receive_info(spec) for worker, spec in zip(workers, specs, strict=True)]
    finally:
        for worker in workers:
            worker.end()


def _describe(spec: str) -> EngineInfo:
    """What an engine has, in this process."""
    try:
        engine, traced, refusal = _engine(spec), (), ""
        try:
            traced = tuple((precision, tracing_precision(engine, precision)) for precision in precisions(engine))
        except Skipped as reason:
            refusal = str(reason)
        names = tuple(accelerator_names(engine))
        return EngineInfo(spec, engine.name, str(engine.version), traced, names, refusal=refusal)
    except RaybenchError as error:
        return EngineInfo(spec, problem=str(error))
    except Exception as error:  # third-party code may raise anything
        return EngineInfo(spec, problem=f"engine {spec!r}: {type(error).__name__}: {error}")


def make_jobs(engines: Sequence[EngineInfo], quick: bool, cases: Sequence[Case] = CASES) -> list[Job]:
    """The jobs of these engines in the order of the tables: by engine, precision and section."""
    jobs = []
    chosen = [case for case in cases if not (quick and case.full_only)]
    for engine in engines:
        for precision, tracing in engine.precisions:
            for section in dict.fromkeys(case.section for case in chosen):
                checks = [
                    (case.id, accelerator)
                    for case in chosen
                    if case.section == section
                    for accelerator in (engine.accelerators if case.each_accelerator else ["auto"])
                ]
                jobs.append(Job(engine, precision, tracing, section, quick, tuple(checks)))
    return jobs


def run_jobs(jobs: Sequence[Job], processes: int) -> Iterator[FinishedJob]:
    """The jobs as they end, in at most `processes` processes; all of these end when the caller stops early."""
    waiting = deque(RunningJob(number, job) for number, job in enumerate(jobs))
    busy: dict[Connection, tuple[_Worker, RunningJob]] = {}
    idle: list[_Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                worker = idle.pop() if idle else _Worker()
                busy[worker.pipe] = worker, worker.begin(waiting.popleft())
            for pipe in wait(list(busy)):
                worker, running = busy[pipe]  # type: ignore[index]
                alive = worker.receive_results(running)
                finished = len(running.results) == len(running.job.checks)
                if alive and not finished:
                    continue
                del busy[pipe]  # type: ignore[arg-type]
                if alive:
                    idle.append(worker)
                if finished:
                    results = [result for results in running.results for result in results]
                    yield FinishedJob(running.number, running.job, results, perf_counter() - running.since)
                else:  # the process died: another one does the rest
                    waiting.appendleft(running)
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.end()


class _Worker:
    """The parent's end of a process."""

    def __init__(self) -> None:
        self.pipe, theirs = SPAWN.Pipe()
        self.process = SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        with _interrupt_ignored():
            self.process.start()
        theirs.close()

    def begin(self, running: RunningJob) -> RunningJob:
        running.since = running.since or perf_counter()
        with suppress(OSError):  # the process died while idle: `receive_results` notices it
            self.pipe.send((running.job, len(running.results)))
        return running

    def receive_results(self, running: RunningJob) -> bool:
        """Adds the results of one check; False where the process has died of it, which is a failure of the check."""
        try:
            running.results.append(self.pipe.recv())
        except (EOFError, OSError):
            self.process.join()
            case, accelerator = running.job.checks[len(running.results)]
            subject = running.job.subject_without_engine(accelerator)
            running.results.append([failure(_case(case), subject, _death(self.process.exitcode or 0))])
            self.pipe.close()
            return False
        return True

    def receive_info(self, spec: str) -> EngineInfo:
        """What the process reports of an engine, or how it died of loading it."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            return EngineInfo(spec, problem=f"engine {spec!r}: {_death(self.process.exitcode or 0)} when it was loaded")

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _death(status: int) -> str:
    how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
    return f"the engine's process {how}"


def _case(id: str) -> Case:
    return next(case for case in CASES if case.id == id)


@contextmanager
def _interrupt_ignored() -> Iterator[None]:
    """Processes started in this context ignore Ctrl-C, which a terminal sends to all of them: the parent handles it."""
    before: Any = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(pipe: Connection) -> None:
    """The worker process: answers an engine's name with an `EngineInfo` and each check of a job with its results."""
    from threadpoolctl import threadpool_limits

    die_with_parent()
    warnings.formatwarning = lambda message, *_, **__: f"raybench: warning: {message}\n"
    with threadpool_limits(1):
        while True:
            try:
                request = pipe.recv()
            except EOFError:
                return
            if isinstance(request, str):
                pipe.send(_describe(request))
                continue
            job, begin = request
            for case, accelerator in job.checks[begin:]:
                pipe.send(list(run_case(_case(case), job.subject(accelerator))))
