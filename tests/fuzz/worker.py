"""Runs cases one after the other: `python -m tests.fuzz.worker MODULE SEED FIRST END FOLDER`, a JSON line for each.

`{"case": 7}` comes before a case, `{"case": 7, "outcome": ..., "what": ..., "seconds": ..., "mebibytes": ...}` after it. An
outcome is "accepted", "refused" (an error of raybench's own that names the file) or "failed". The input stays in
FOLDER/7 until the case has ended well.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import shutil
import sys
import traceback
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Any, NamedTuple

from engines.errors import RaybenchError

MEBIBYTES = 2048
"""More that one case adds to the resident memory is a failure; a kind may set its own limit."""
ADDRESS_SPACE = 3 << 30
"""Bytes beyond those at the start that a worker may reserve: what runs away ends there and not with the machine."""
LONGEST = 1000
"""Characters of a message."""
ROOT = Path(__file__).resolve().parents[2]


class Outcome(NamedTuple):
    """How a case ended."""

    outcome: str
    what: str
    seconds: float
    mebibytes: float


def run_case(module: Any, seed: int, case: int, folder: Path) -> Outcome:
    """Writes the case's input into `folder`, which is made, and reads it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    module.write(Random(f"{module.__name__}/{seed}/{case}"), folder)
    names = [*(path.name for path in folder.iterdir()), *getattr(module, "ALSO_NAMED", ())]
    before = _forget_peak()
    start = perf_counter()
    outcome, what = _judged(module, folder, names)
    seconds, mebibytes = perf_counter() - start, _status("VmHWM") - before
    if mebibytes > getattr(module, "MEBIBYTES", MEBIBYTES):
        outcome, what = "failed", f"took {mebibytes:.0f} MiB"
    return Outcome(outcome, what, seconds, mebibytes)


def _judged(module: Any, folder: Path, names: list[str]) -> tuple[str, str]:
    try:
        module.read(folder)
    except RaybenchError as error:
        message = str(error)
        if any(isinstance(cause, MemoryError) for cause in _causes(error)):
            return "failed", f"memory ran out: {message}"
        if "\n" in message or len(message) > LONGEST:
            return "failed", f"its message is not one line of {LONGEST} characters: {message[:200]!r}"
        if not any(name in message for name in names):
            return "failed", f"its message names none of {', '.join(names)}: {message}"
        return "refused", message
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return "failed", f"{_place(error)}: {type(error).__name__}: {error}"
    return "accepted", ""


def _causes(error: BaseException | None) -> list[BaseException]:
    found: list[BaseException] = []
    while error is not None and error not in found:
        found.append(error)
        error = error.__cause__ or error.__context__
    return found


def _place(error: BaseException) -> str:
    """The innermost line of the repository that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(ROOT) and ".venv" not in frame.filename]
    frame = (ours or frames)[-1]
    return f"{os.path.relpath(frame.filename, ROOT)}:{frame.lineno}"


def _forget_peak() -> float:
    """Resident MiB now; the highest of before is forgotten."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def _status(key: str) -> float:
    """MiB of a line of /proc/self/status; 0 where there is no such file."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith(f"{key}:")), 0.0)


def _limit_memory() -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        size = int(_status("VmSize") * 2**20) + ADDRESS_SPACE
        resource.setrlimit(resource.RLIMIT_AS, (size, size))


def main(name: str, seed: int, first: int, end: int, folder: Path) -> None:
    """Runs the cases in [first, end)."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print does not mix with the answers
    module = importlib.import_module(name)
    _limit_memory()
    for case in range(first, end):
        print(json.dumps({"case": case}), file=answers)
        inputs = folder / str(case)
        outcome = run_case(module, seed, case, inputs)
        if outcome.outcome != "failed":
            shutil.rmtree(inputs, ignore_errors=True)
        print(json.dumps({"case": case, **outcome._asdict()}), file=answers)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
