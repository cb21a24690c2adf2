"""The worker process of one tab: `python -m harness.view.worker`, with messages on its pipes (see `messages`).

Every message follows four bytes of length. The first request, `begin`, chooses the controller: `view`, `race` or
`dahlquist`. A thread reads requests, so that a stop is received during a render.
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
from harness.view.messages import error_message, packed

NICE = 5
"""Renders have a lower priority than the server, the browser and the publishing threads, which then answer at once."""
PIPE_BYTES = 1 << 20
"""A frame then needs one or two writes; with the 64 KiB of Linux both processes must wake up for each part."""
F_SETPIPE_SZ = 1031


class Controller(Protocol):
    """What runs a page. `receive` is called on the reading thread and returns at once; `start` sends the menu and starts
    threads; `run` renders, on the main thread, and never returns."""

    def receive(self, request: Any) -> None: ...

    def start(self) -> None: ...

    def run(self) -> None: ...


class Pipes:
    """The pipes to the server, on stdin and stdout; other output goes to stderr."""

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
        """The next request; ends the process when the server has ended."""
        length = self._requests.read(4)
        data = self._requests.read(int.from_bytes(length, "little")) if len(length) == 4 else b""
        if not data:
            os._exit(0)
        return json.loads(data)

    def send(self, message: bytes) -> None:
        """Writes a whole message, from any thread."""
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
    import harness.view.view_controller  # noqa: F401
    from harness.view.menu import engines_listed

    engines_listed()  # so that a reserve worker has done its imports
    pipes.send(packed({"type": "ready"}))
    begin = pipes.receive()
    try:
        controller = controller_of(begin, pipes.send)
    except Exception as error:
        traceback.print_exc()
        pipes.send(error_message(one_line(error)))
        return
    controller.start()
    threading.Thread(target=listen, args=(pipes, controller), daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICE)  # on Linux this thread's own, and that of threads it starts: the engines'
    controller.run()


def listen(pipes: Pipes, controller: Controller) -> None:
    """Passes requests to the controller; an invalid one is answered with an error message."""
    from harness.view.requests import checked

    while True:
        given = pipes.receive()
        try:
            controller.receive(checked(given))
        except Exception as error:
            pipes.send(error_message(one_line(error)))


def controller_of(begin: Mapping[str, Any], send: Callable[[bytes], None]) -> Controller:
    from pathlib import Path

    from harness.view.library import Library

    library, allow_imports = Library(Path(begin["folder"]), begin["parameters"]), bool(begin["allow_imports"])
    allow_outside = bool(begin["allow_outside"])
    if begin["page"] == "race":
        from harness.view.race_controller import RaceController

        return RaceController(send, library, Path(begin["scratch"]), allow_imports, allow_outside)
    if begin["page"] == "dahlquist":
        from harness.view.dahlquist_controller import DahlquistController

        return DahlquistController(send)
    from harness.view.view_controller import ViewController

    return ViewController(send, library, allow_imports, allow_outside)


if __name__ == "__main__":
    main()
