"""The live viewer: pages, served on this machine only, that show images while they are refined, and races.

`server` serves pages and sockets; a tab has a `session` and a worker process of its own (`worker`), so that a crash ends the
render of one tab only. They exchange `messages`. In the worker a controller runs the page: `view_controller` (one image),
`race_controller` (contestants one after another) or `dahlquist_controller` (Dahlquist's program). The pages are in `page/`.
"""

from __future__ import annotations

from engines.errors import ConfigError
from engines.packages import install_extra
from harness.view.options import ViewOptions


def open_viewer(options: ViewOptions) -> None:
    """Serves until interrupted. Raises `ConfigError` where the extra `view` is not installed, and where `server.serve` does."""
    try:
        from harness.view.server import serve
    except ImportError as error:
        raise ConfigError(f"the viewer needs {error.name}: {install_extra('view')}") from error
    serve(options)
