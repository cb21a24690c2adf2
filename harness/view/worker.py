"""The process that renders for one tab: `python -m harness.view.worker`, messages on its pipes (see `messages`).

Four bytes of length go before every message. The first request, `begin`, says which desk works here: `view`, `race` or
`demo`. A thread reads requests as they come, so that a stop is heard while something renders.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from harness.processes import die_with_parent, one_line
from harness.view.messages import packed, problem

NICE = 5
"""Renders stand behind the server, the browser, and the threads that tell of them, so that those answer at once."""
PIPE_BYTES = 1 << 20
"""A frame then passes in a write or two; with Linux's 64 KiB every part of it waits for two processes to wake."""
F_SETPIPE_SZ = 1031


class Desk(Protocol):
    """What a tab shows. `hear` is called on the reading thread and returns at once; `start` tells what there is and starts
    threads; `run` works, on the main thread, and never returns."""

    def hear(self, request: Any) -> None: ...

    def start(self) -> None: ...

    def run(self) -> None: ...


class Pipes:
    """The server's ends; whatever else prints goes to stderr."""

    def __init__(self) -> None:
        self._requests = open(os.dup(0), "rb")  # noqa: SIM115 (open as long as the process)
        self._answers = open(os.dup(1), "wb", buffering=0)  # noqa: SIM115
        self._writing = threading.Lock()
        if sys.platform == "linux":
            import fcntl

            with contextlib.suppress(OSError):  # more than the system allows
                fcntl.fcntl(self._answers, F_SETPIPE_SZ, PIPE_BYTES)
        os.dup2(2, 1)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)

    def receive(self) -> dict[str, Any]:
        """The next request; ends the process when the server has gone."""
        length = self._requests.read(4)
        data = self._requests.read(int.from_bytes(length, "little")) if len(length) == 4 else b""
        if not data:
            os._exit(0)
        return json.loads(data)

    def send(self, message: bytes) -> None:
        """Writes a message whole; from any thread."""
        view = memoryview(len(message).to_bytes(4, "little") + message)
        try:
            with self._writing:
                while view:
                    view = view[self._answers.write(view) :]
        except BrokenPipeError:
            os._exit(0)


def main() -> None:
    die_with_parent()
    pipes = Pipes()
    import harness.view.live  # noqa: F401
    from harness.view.menu import engines_listed

    engines_listed()  # a worker that waits for a tab has its imports behind it
    pipes.send(packed({"is": "ready"}))
    begin = pipes.receive()
    try:
        desk = desk_of(begin, pipes.send)
    except Exception as error:
        traceback.print_exc()
        pipes.send(problem(one_line(error)))
        return
    desk.start()
    threading.Thread(target=listen, args=(pipes, desk), daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICE)  # on Linux this thread's own, and that of threads it starts: the engines'
    desk.run()


def listen(pipes: Pipes, desk: Desk) -> None:
    """Hands requests on; what is wrong with one is told."""
    from harness.view.requests import checked

    while True:
        given = pipes.receive()
        try:
            desk.hear(checked(given))
        except Exception as error:
            pipes.send(problem(one_line(error)))


def desk_of(begin: Mapping[str, Any], send: Callable[[bytes], None]) -> Desk:
    from pathlib import Path

    from harness.view.library import Library

    library, allow_imports = Library(Path(begin["folder"])), bool(begin["allow_imports"])
    if allow_imports:
        sys.path.insert(0, os.getcwd())
    if begin["desk"] == "race":
        from harness.view.race import RaceDesk

        return RaceDesk(send, library, Path(begin["scratch"]), allow_imports)
    if begin["desk"] == "dahlquist":
        from harness.view.demo import DemoDesk

        return DemoDesk(send)
    from harness.view.live import ViewDesk

    return ViewDesk(send, library, allow_imports)


if __name__ == "__main__":
    main()
