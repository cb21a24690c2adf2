"""Runs the cases of a kind in worker processes, and notes those that die or hang: the rest of the cases goes on."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from tests.fuzz.worker import ROOT

KINDS = ("scenes", "mitsuba", "meshes", "gltf", "images", "configs", "events")
CHUNK = 250
"""Cases of one worker process."""
START_SECONDS = 120.0
"""A worker may take as long to import what it needs."""


@dataclass(slots=True)
class Failure:
    """A case that did not end as it should."""

    case: int
    what: str


@dataclass(slots=True)
class Tally:
    """What became of a kind's cases; `seconds` and `mebibytes` of the worst one."""

    kind: str
    cases: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    mebibytes: float = 0.0
    failures: list[Failure] = field(default_factory=list)

    def add(self, case: int, outcome: str, what: str, seconds: float, mebibytes: float) -> None:
        self.cases += 1
        self.accepted += outcome == "accepted"
        self.refused += outcome == "refused"
        self.seconds, self.mebibytes = max(self.seconds, seconds), max(self.mebibytes, mebibytes)
        if outcome == "failed":
            self.failures.append(Failure(case, what))


def run(kind: str, seed: int, first: int, end: int, folder: Path, jobs: int = 1, limit: float = 20.0) -> Tally:
    """The cases [first, end) of a kind, a module of `tests.fuzz` or a dotted name; failing inputs stay in `folder`/<case>.

    `limit`: seconds after which a case counts as hanging.
    """
    tally = Tally(kind)
    chunks = [(start, min(start + CHUNK, end)) for start in range(first, end, CHUNK)]
    with ThreadPoolExecutor(jobs) as pool:
        for answers in pool.map(lambda chunk: list(_chunk(kind, seed, *chunk, folder, limit)), chunks):
            for answer in answers:
                tally.add(**answer)
    return tally


def _chunk(kind: str, seed: int, first: int, end: int, folder: Path, limit: float) -> Iterator[dict]:
    """The answers to the cases [first, end); a worker that is lost is replaced by one that begins with the next case."""
    while first < end:
        with tempfile.TemporaryFile() as log:
            module = kind if "." in kind else f"tests.fuzz.{kind}"
            words = [sys.executable, "-m", "tests.fuzz.worker", module, str(seed), str(first), str(end), str(folder)]
            # Unbuffered: `select` does not see what a buffer holds.
            pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": log, "bufsize": 0}
            with subprocess.Popen(words, cwd=ROOT, **pipes) as worker:
                assert worker.stdout is not None
                for answer in _answers(worker.stdout, limit):
                    if "outcome" in answer:
                        yield answer
                        first = answer["case"] + 1
                    else:
                        first = answer["case"]
                hung = worker.poll() is None and not _ended(worker)
                worker.kill()
            if first < end:
                lost = f"no answer within {limit:g} s" if hung else _death(worker.returncode, log)
                yield {"case": first, "outcome": "failed", "what": lost, "seconds": limit if hung else 0.0, "mebibytes": 0.0}
                first += 1


def _answers(pipe: IO[bytes], limit: float) -> Iterator[dict]:
    """The worker's lines until it ends or is silent for too long."""
    wait = START_SECONDS
    while select.select([pipe], [], [], wait)[0]:
        line = pipe.readline()
        if not line.endswith(b"\n"):
            return
        yield json.loads(line)
        wait = limit


def _ended(worker: subprocess.Popen[bytes]) -> bool:
    """Whether a worker whose answers ended is gone, or will be soon."""
    assert worker.stdout is not None
    if not select.select([worker.stdout], [], [], 0)[0]:
        return False
    worker.wait(START_SECONDS)
    return True


def _death(status: int, log: IO[bytes]) -> str:
    how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines() or [""]
    return f"the process {how}: {lines[-1][:200]}"
