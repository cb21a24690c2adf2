"""A page's socket, without the page."""

import json
import time
from contextlib import ExitStack

from websockets.sync.client import connect

from harness.view.messages import BEGIN_WORK, header_of


class Tab:
    """Opens it; use it as a context."""

    def __init__(self, viewer, desk="view", **headers):
        host = f"127.0.0.1:{viewer.port}"
        headers = {"Origin": f"http://{host}", **headers}
        self.seq = 0
        self._stack = ExitStack()
        self.socket = self._stack.enter_context(connect(
            f"ws://{host}/{viewer.token}/desk/{desk}", additional_headers=headers, max_size=None, compression=None,
            close_timeout=2, open_timeout=300,
        ))  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self._stack.close()

    def send(self, **request):
        """Sends a request; the number under which the worker knows it, where it makes work."""
        self.socket.send(json.dumps(request))
        self.seq += request["do"] in BEGIN_WORK
        return self.seq

    def hear(self, wanted, seconds=300):
        """The next message that `wanted` accepts; frames are acknowledged on the way."""
        end = time.monotonic() + seconds
        while True:
            told = header_of(self.socket.recv(timeout=max(0.01, end - time.monotonic())))
            if told["is"] == "frame":
                self.send(do="ack")
            if wanted(told):
                return told

    def state(self, *states, seconds=300):
        return self.hear(lambda told: told["is"] == "state" and told["state"] in states, seconds)
