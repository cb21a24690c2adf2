"""`raybench` in a process of its own, which is forked from one that has imported what the commands need: to import it takes
longer than most commands. Python's own start and `python -m harness` are tested in tests/harness/test_cli.py."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["harness.cli", "harness.cli.experiments", "harness.report", "engines"])


def raybench(
    arguments: Sequence[str], cwd: Path | None, environment: Mapping[str, str], merged: bool = False,
    timeout: float | None = None,
) -> subprocess.CompletedProcess[str]:  # fmt: skip
    """What `raybench ARGUMENTS` does in that folder and environment; where `merged`, stdout has what goes to stderr, too.

    After `timeout` seconds it is killed; raises `subprocess.TimeoutExpired`.
    """
    words = ["raybench", *arguments]
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "stdout", Path(folder) / "stderr"
        for path in (out, err):
            path.touch()
        outputs = str(out), str(out if merged else err)
        process = FORKS.Process(target=_command, args=(words, str(cwd or Path.cwd()), dict(environment), outputs))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(words, timeout or 0.0)
        return subprocess.CompletedProcess(words, process.exitcode, out.read_text(), err.read_text())


def _command(words: list[str], cwd: str, environment: dict[str, str], outputs: tuple[str, str]) -> None:
    """What the command does, in this process, which it ends."""
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for path, stream in zip(outputs, (sys.stdout, sys.stderr), strict=True):
        with open(path, "ab") as file:
            stream.flush()
            os.dup2(file.fileno(), stream.fileno())
    sys.path[:0] = environment.get("PYTHONPATH", "").split(os.pathsep)
    from harness.cli import main

    sys.argv = words
    main()
