"""The worker process of one tab: `main` is run by `engines.processes.child`. Its messages: `messages`.

The first request, `begin`, chooses the controller: `view`, `race` or `dahlquist`. A thread reads requests, so that a stop is
received during a render.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engines.processes import Channel
from harness.view.messages import failure_message, packed

if TYPE_CHECKING:
    from harness.view.controller import Controller

NICE = 5
"""Renders have a lower priority than the server, the browser and the publishing threads, which then answer at once."""


def main(descriptors: Sequence[int], arguments: Sequence[str]) -> None:
    """Serves the tab whose server is at the socket `descriptors[0]`."""
    server = Channel.at(descriptors[0], exits=True)
    import harness.view.view_controller  # noqa: F401
    from harness.view.menu import engines_listed

    engines_listed()  # so that a reserve worker has done its imports
    server.send(packed({"type": "ready"}))
    begin = json.loads(server.receive().data)
    try:
        controller = controller_of(begin, server.send)
    except Exception as error:
        server.send(failure_message(error))
        return
    controller.start()
    threading.Thread(target=listen, args=(server, controller), daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICE)  # on Linux this thread's own, and that of threads it starts: the engines'
    controller.run()


def listen(server: Channel, controller: Controller) -> None:
    """Passes requests to the controller; an invalid one is answered with an error message."""
    from harness.view.requests import checked

    while True:
        message = json.loads(server.receive().data)
        try:
            controller.receive(checked(message))
        except Exception as error:
            server.send(failure_message(error))


def controller_of(begin: Mapping[str, Any], send: Callable[[bytes], None]) -> Controller:
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
