"""The battery in processes side by side: each takes one part after the other, and one that dies is a finding.

A part is a section asked of an engine in one precision. Processes are spawned, not forked, since engines start threads of
their own; a process keeps what an engine has compiled or loaded for the parts that follow. What an engine can be asked is
found in such a process, too: the parent imports no engine, and no native library outlives a verdict in it.
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
from harness.processes import die_with_parent
from harness.verify.battery import CASES, Finding, broken, examine
from harness.verify.case import Case
from harness.verify.promises import tracing_precision
from harness.verify.subject import Declined, Subject, accelerators, precisions

SPAWN = multiprocessing.get_context("spawn")


_engine = cache(registry.engine)


class Known(NamedTuple):
    """What a process says of an engine: `asked` is the name that imports it, `precisions` maps settings to what it traces in.

    `problem`: why it cannot be loaded. `refusal`: why it renders nothing at all.
    """

    asked: str
    name: str = ""
    version: str = ""
    precisions: tuple[tuple[str, str], ...] = ()
    accelerators: tuple[str, ...] = ()
    problem: str = ""
    refusal: str = ""


class Part(NamedTuple):
    """`asks`: (id of a case, accelerator), in the order of the findings; `tracing` what the engine traces in."""

    engine: Known
    precision: str
    tracing: str
    section: str
    quick: bool
    asks: tuple[tuple[str, str], ...]

    @property
    def words(self) -> str:
        return f"{self.engine.asked} {self.precision} {self.section}"

    def subject(self, accelerator: str) -> Subject:
        return Subject(_engine(self.engine.asked), self.precision, accelerator, self.quick)

    def died(self, accelerator: str) -> Subject:
        """The subject's name and version, without the engine."""
        name, version = self.engine.name, self.engine.version
        engine: Any = SimpleNamespace(name=name, version=version, tracing_precision=self.tracing)
        return Subject(engine, self.precision, accelerator, self.quick)


@dataclass
class Work:
    """A part under way, and what it has found so far: a list of findings for each of its asks."""

    number: int
    part: Part
    found: list[list[Finding]] = field(default_factory=list)
    since: float = 0.0


class Done(NamedTuple):
    """A finished part: its place among all of them, its findings, and the seconds between its begin and its end."""

    number: int
    part: Part
    findings: list[Finding]
    seconds: float


def known(names: Sequence[str]) -> list[Known]:
    """What these engines can be asked, each told by a process of its own; one that dies or fails has a `problem`."""
    workers = [_Worker() for _ in names]
    try:
        for worker, name in zip(workers, names, strict=True):
            worker.pipe.send(name)
        return [worker.told(name) for worker, name in zip(workers, names, strict=True)]
    finally:
        for worker in workers:
            worker.end()


def _known(name: str) -> Known:
    """What this process says of an engine."""
    try:
        engine, traced, refusal = _engine(name), (), ""
        try:
            traced = tuple((precision, tracing_precision(engine, precision)) for precision in precisions(engine))
        except Declined as reason:
            refusal = str(reason)
        return Known(name, engine.name, str(engine.version), traced, tuple(accelerators(engine)), refusal=refusal)
    except RaybenchError as error:
        return Known(name, problem=str(error))
    except Exception as error:  # what others wrote may fail in any way
        return Known(name, problem=f"engine {name!r}: {type(error).__name__}: {error}")


def parts(engines: Sequence[Known], quick: bool, cases: Sequence[Case] = CASES) -> list[Part]:
    """What is asked of these engines, in the order in which it is printed: by engine, precision and section."""
    made = []
    chosen = [case for case in cases if not (quick and case.full_only)]
    for engine in engines:
        for precision, tracing in engine.precisions:
            for section in dict.fromkeys(case.section for case in chosen):
                asks = [(case.id, accelerator) for case in chosen if case.section == section
                        for accelerator in (engine.accelerators if case.each_accelerator else ["auto"])]  # fmt: skip
                made.append(Part(engine, precision, tracing, section, quick, tuple(asks)))
    return made


def run(asked: Sequence[Part], jobs: int) -> Iterator[Done]:
    """The parts as they end, by at most `jobs` processes; all of them are ended when the caller stops early."""
    waiting = deque(Work(number, part) for number, part in enumerate(asked))
    busy: dict[Connection, tuple[_Worker, Work]] = {}
    idle: list[_Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < jobs:
                worker = idle.pop() if idle else _Worker()
                busy[worker.pipe] = worker, worker.begin(waiting.popleft())
            for pipe in wait(list(busy)):
                worker, work = busy[pipe]  # type: ignore[index]
                alive = worker.hear(work)
                finished = len(work.found) == len(work.part.asks)
                if alive and not finished:
                    continue
                del busy[pipe]  # type: ignore[arg-type]
                if alive:
                    idle.append(worker)
                if finished:
                    findings = [finding for found in work.found for finding in found]
                    yield Done(work.number, work.part, findings, perf_counter() - work.since)
                else:  # the process died: another one does the rest
                    waiting.appendleft(work)
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.end()


class _Worker:
    """The parent's end of a process."""

    def __init__(self) -> None:
        self.pipe, theirs = SPAWN.Pipe()
        self.process = SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        with _deaf():
            self.process.start()
        theirs.close()

    def begin(self, work: Work) -> Work:
        work.since = work.since or perf_counter()
        with suppress(OSError):  # it died while it was idle: `hear` will say so
            self.pipe.send((work.part, len(work.found)))
        return work

    def hear(self, work: Work) -> bool:
        """Takes the findings of one ask; False where the process has died over it, which is a finding too."""
        try:
            work.found.append(self.pipe.recv())
        except (EOFError, OSError):
            self.process.join()
            case, accelerator = work.part.asks[len(work.found)]
            work.found.append([broken(_case(case), work.part.died(accelerator), _death(self.process.exitcode or 0))])
            self.pipe.close()
            return False
        return True

    def told(self, name: str) -> Known:
        """What the process answers about an engine, or that it died of it."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            return Known(name, problem=f"engine {name!r}: {_death(self.process.exitcode or 0)} when it was loaded")

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
def _deaf() -> Iterator[None]:
    """Processes started meanwhile ignore ctrl-C, which reaches all of a terminal's: the parent alone answers it."""
    before: Any = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(pipe: Connection) -> None:
    """The process: answers an engine's name by what is known of it, each ask of a part by its findings, until it is ended."""
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
                pipe.send(_known(request))
                continue
            part, begin = request
            for case, accelerator in part.asks[begin:]:
                pipe.send(examine(_case(case), part.subject(accelerator)))
