"""The harness: configs to cells, cells to timed renders, renders to metrics, tables, plots and a report.

From Python, `harness.open_results(folder)` gives what a run has measured as pandas DataFrames.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.analysis.frames import open_results

__all__ = ["open_results"]


def __getattr__(name: str) -> Any:
    if name != "open_results":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from harness.analysis import frames

    return frames.open_results


def __dir__() -> list[str]:
    return sorted(__all__)
