"""The suite in worker processes: each runs one job after another, and a process that dies is a failed check.

A job is one section of cases for one engine in one precision. A process keeps what an engine has compiled or loaded for its
next jobs. The parent imports no engine: worker processes list what an engine has, too, so no native library can crash the
parent after the results are known.
"""

from __future__ import annotations

import os
import select
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import cache
from time import perf_counter
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeVar

from engines import registry
from engines.errors import RaybenchError
from engines.imports import users_folders
from engines.processes import BadMessage, Channel, Closed, Process, pickled
from harness.check_results import CheckResult
from harness.processes import python_path
from harness.verify.case import Case
from harness.verify.subject import Skipped, Subject, accelerator_names, precisions
from harness.verify.suite import CASES, case_of, failure, run_case
from harness.verify.tolerances import tracing_precision

T = TypeVar("T")
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


@dataclass
class RunningJob:
    """A job in progress: `results` has one list per finished check."""

    number: int
    job: Job
    results: list[list[CheckResult]] = field(default_factory=list)
    since: float = 0.0

    @property
    def finished(self) -> bool:
        return len(self.results) == len(self.job.checks)

    def fail(self, note: str) -> None:
        """The process died of the next check, which is a failure of it."""
        case, accelerator = self.job.checks[len(self.results)]
        name, version = self.job.engine.name, self.job.engine.version
        engine: Any = SimpleNamespace(name=name, version=version, tracing_precision=self.job.tracing)
        self.results.append([failure(case_of(case), Subject(engine, self.job.precision, accelerator, self.job.quick), note)])


class FinishedJob(NamedTuple):
    """`number`: the job's index among all; `seconds` from its begin to its end."""

    number: int
    job: Job
    results: list[CheckResult]
    seconds: float


def describe_engines(specs: Sequence[str]) -> list[EngineInfo]:
    """What these engines have, each reported by a process of its own; one that dies or fails has a `problem`."""
    with ExitStack() as stack:
        workers = [_Worker(stack) for _ in specs]
        for worker, spec in zip(workers, specs, strict=True):
            worker.call(_describe, spec)
        return [worker.description(spec) for worker, spec in zip(workers, specs, strict=True)]


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
                    for accelerator in case.accelerators(engine.accelerators)
                ]
                jobs.append(Job(engine, precision, tracing, section, quick, tuple(checks)))
    return jobs


def run_jobs(jobs: Sequence[Job], processes: int) -> Iterator[FinishedJob]:
    """The jobs as they end, in at most `processes` processes; all of these end when the caller stops early."""
    waiting = deque(RunningJob(number, job) for number, job in enumerate(jobs))
    busy: dict[Channel, tuple[_Worker, RunningJob]] = {}
    idle: list[_Worker] = []
    with ExitStack() as stack:
        while waiting or busy:
            while waiting and len(busy) < processes:
                worker, running = idle.pop() if idle else _Worker(stack), waiting.popleft()
                running.since = running.since or perf_counter()
                worker.begin(running)
                busy[worker.channel] = worker, running
            for channel in select.select(list(busy), [], [])[0]:
                worker, running = busy[channel]
                try:
                    running.results.append(worker.receive(list))
                    if not running.finished:
                        worker.begin(running)
                        continue
                    idle.append(worker)
                except _Died as death:
                    running.fail(str(death))
                del busy[channel]
                if running.finished:
                    results = [result for results in running.results for result in results]
                    yield FinishedJob(running.number, running.job, results, perf_counter() - running.since)
                else:  # another process does the rest
                    waiting.appendleft(running)


class _Worker:
    """The parent's end of a process that calls functions of this module; it ends with `stack`."""

    def __init__(self, stack: ExitStack) -> None:
        environment = {**os.environ, "PYTHONPATH": python_path(users_folders())}
        self.process = Process("harness.verify.parallel:serve", environment=environment)
        stack.callback(self.process.kill)
        (self.channel,) = self.process.channels

    def call(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Asks for a value, which `receive` returns."""
        with suppress(Closed):  # the process died while idle: `receive` notices it
            pickled.send(self.channel, (function, arguments))

    def begin(self, running: RunningJob) -> None:
        """Asks for the results of a job's next check."""
        self.call(_check, running.job, *running.job.checks[len(running.results)])

    def receive(self, kind: type[T]) -> T:
        """The value asked for. Raises `_Died`."""
        try:
            answer = pickled.receive(self.channel)
            if not isinstance(answer, kind):
                raise BadMessage(f"it sent {answer!r:.80} where {kind.__name__} is expected")
            return answer
        except Closed:
            ending = self.process.ended()
        except (BadMessage, pickled.Unreadable) as error:
            ending = f"was killed: {error}"
        self.process.kill()
        raise _Died(f"the engine's process {ending}")

    def description(self, spec: str) -> EngineInfo:
        """What the process reports of an engine, or how it died of loading it."""
        try:
            return self.receive(EngineInfo)
        except _Died as death:
            return EngineInfo(spec, problem=f"engine {spec!r}: {death} when it was loaded")


class _Died(Exception):
    """A worker process has ended; says how."""


# ---- in a worker process ---------------------------------------------------------------------------------------------


def serve(descriptors: Sequence[int], arguments: Sequence[str]) -> None:
    """Calls functions until the parent closes the socket `descriptors[0]`."""
    from threadpoolctl import threadpool_limits

    warnings.formatwarning = lambda message, *_, **__: f"raybench: warning: {message}\n"
    channel = Channel.at(descriptors[0])
    with threadpool_limits(1), suppress(Closed):
        while True:
            function, values = pickled.receive(channel)
            pickled.send(channel, function(*values))


def _check(job: Job, case: str, accelerator: str) -> list[CheckResult]:
    subject = Subject(_engine(job.engine.spec), job.precision, accelerator, job.quick)
    return list(run_case(case_of(case), subject))


def _describe(spec: str) -> EngineInfo:
    """What an engine has."""
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
