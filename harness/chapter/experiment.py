"""The experiment of the dissertation: accelerators, threads, shaders and samplers over its scenes."""

from __future__ import annotations

from pathlib import Path

from harness.analysis import Analysis
from harness.chapter.document import Section


def section(analysis: Analysis, plots: Path) -> Section:
    """The section of one results folder."""
    return Section("The experiment")
