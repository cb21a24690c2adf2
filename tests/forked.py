"""Processes that are forked from one that has imported what commands and workers need: to import it takes longer than most of
them. Python's own start, `python -m harness` and workers as users have them are tested in tests/harness/test_cli.py and by the
commands of the other tests."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    ["harness.cli", "harness.cli.experiments", "harness.report", "harness.run.sweep", "harness.measure.clock", "engines"]
)

SERVER = forkserver._forkserver
ADDRESS = ("_forkserver_address", "_forkserver_authkey")
"""Where Python's server of forks is reached; the key is new in Python 3.14."""


class Forked:
    """`function(*arguments)` in a process of its own with that folder and environment. Has what the tests and
    `engines.processes.process` use of `subprocess.Popen`, in whose place it stands."""

    def __init__(
        self,
        function: Callable[..., object],
        arguments: Sequence[Any],
        cwd: str | Path | None,
        environment: Mapping[str, str],
        stdout: str | Path = os.devnull,
        stderr: str | Path = os.devnull,
        new_session: bool = False,
    ) -> None:
        """Output is added to the files `stdout` and `stderr`."""
        self.returncode: int | None = None
        SERVER.ensure_running()
        shared = {name: value for name, value in vars(SERVER).items() if name in ADDRESS}
        place = str(cwd or Path.cwd()), dict(environment), (str(stdout), str(stderr)), new_session, shared
        self._process = FORKS.Process(target=_run, args=(function, tuple(arguments), *place))
        self._process.start()
        self.pid = self._process.pid

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(str(self._process), timeout or 0.0)
        self.returncode = self._process.exitcode
        return self.returncode

    def poll(self) -> int | None:
        self.returncode = self._process.exitcode
        return self.returncode

    def kill(self) -> None:
        self._process.kill()


def _run(
    function: Callable[..., object],
    arguments: tuple[Any, ...],
    cwd: str,
    environment: dict[str, str],
    outputs: tuple[str, str],
    new_session: bool,
    shared: dict[str, Any],
) -> None:
    """Calls the function in this process, whose own processes are forked from the server that it came from itself."""
    vars(SERVER).update(shared, ensure_running=lambda: None)
    if new_session:
        os.setsid()
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for path, stream in zip(outputs, (sys.stdout, sys.stderr), strict=True):
        with open(path, "ab") as file:
            stream.flush()
            os.dup2(file.fileno(), stream.fileno())
    sys.path[:0] = environment.get("PYTHONPATH", "").split(os.pathsep)
    function(*arguments)


def raybench(
    arguments: Sequence[str],
    cwd: Path | None,
    environment: Mapping[str, str],
    merged: bool = False,
    timeout: float | None = None,
    largest_file: int | None = None,
) -> subprocess.CompletedProcess[str]:
    """What `raybench ARGUMENTS` does in that folder and environment; where `merged`, stdout has what goes to stderr, too.

    After `timeout` seconds it is killed; raises `subprocess.TimeoutExpired`. It writes no files of more than `largest_file`
    bytes.
    """
    words = ["raybench", *arguments]
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "stdout", Path(folder) / "stderr"
        for path in (out, err):
            path.touch()
        process = Forked(_command, [words, largest_file], cwd, environment, out, out if merged else err)
        try:
            code = process.wait(timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        return subprocess.CompletedProcess(words, code, out.read_text(), err.read_text())


def _command(words: list[str], largest_file: int | None) -> None:
    from harness.cli import main

    if largest_file is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, resource.RLIM_INFINITY))
    sys.argv = words
    main()


@contextmanager
def workers() -> Iterator[None]:
    """Within, workers of `harness.measure.pool` that this process starts are forked, too. Their imports take no time."""
    from engines.processes import process

    def start(command: Sequence[str], *, stderr: Any, env: Mapping[str, str], pass_fds: Sequence[int], **options: Any) -> Any:
        _, _, target, _, dies_with_it, _, *arguments = command
        if target != "harness.measure.worker:main":
            return subprocess.Popen(command, stderr=stderr, env=env, pass_fds=pass_fds, **options)
        assert options["start_new_session"] and dies_with_it == "1"
        (descriptor,) = pass_fds
        with socket.socket(fileno=os.dup(descriptor)) as theirs:
            return Forked(_worker, [target, theirs, *arguments], None, env, stderr.name, stderr.name, new_session=True)

    stands_in = SimpleNamespace(Popen=start, DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired)
    with mock.patch.object(process, "subprocess", stands_in):
        yield


def _worker(target: str, theirs: socket.socket, *arguments: str) -> None:
    from engines.processes.child import run

    run(target, os.getppid(), True, [theirs.detach()], arguments)
