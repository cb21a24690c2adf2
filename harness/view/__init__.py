"""The live viewer: a page served on this machine only, which shows images while they are refined, and races.

`server` answers the browser, one `session` a tab. What renders is a process of its own for each tab (`worker`), so that a
crash ends one tab's render and nothing else. Between them go messages (`messages`); what is drawn in a tab is `live` (one
image), `race` (lanes side by side) or `demo` (Dahlquist's program). The pages lie in `page/`.
"""

from __future__ import annotations

from pathlib import Path

from engines.errors import ConfigError


def open_viewer(scene: str, folder: Path, port: int, engine: str, allow_imports: bool, browser: bool) -> None:
    """Serves until interrupted. Raises `ConfigError` where the extra `view` is not installed, and as `server.serve` does."""
    try:
        from harness.view.server import serve
    except ImportError as error:
        raise ConfigError(f"the viewer needs {error.name}: pip install 'raybench[view]'") from error
    serve(scene, folder, port, engine, allow_imports, browser)
