"""The socket of a page, without the page."""

import json
import time
from contextlib import ExitStack

from websockets.sync.client import connect

from harness.view.messages import STARTS_RENDERING, header_of


class Tab:
    """An open socket; use it as a context."""

    def __init__(self, viewer, page="view", **headers):
        host = f"127.0.0.1:{viewer.port}"
        headers = {"Origin": f"http://{host}", **headers}
        self.seq = 0
        self._stack = ExitStack()
        self.socket = self._stack.enter_context(
            connect(
                f"ws://{host}/{viewer.token}/socket/{page}",
                additional_headers=headers,
                max_size=None,
                compression=None,
                close_timeout=2,
                open_timeout=300,
            )
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self._stack.close()

    def send(self, **request):
        """Sends a request and returns the `seq` of the latest request that starts rendering."""
        self.socket.send(json.dumps(request))
        self.seq += request["type"] in STARTS_RENDERING
        return self.seq

    def receive(self, wanted, seconds=300):
        """The header of the next message that `wanted` accepts; acknowledges the frames before it."""
        end = time.monotonic() + seconds
        while True:
            header = header_of(self.socket.recv(timeout=max(0.01, end - time.monotonic())))
            if header["type"] == "frame":
                self.send(type="ack")
            if wanted(header):
                return header

    def state(self, *states, seconds=300):
        return self.receive(lambda header: header["type"] == "state" and header["state"] in states, seconds)
