"""A second process that draws its share of the figures: `python -m harness.report.plots.parallel`, charts in, files out.

A new interpreter, not a fork: the first process may hold engines with threads of their own. What is drawn is the same
to the byte, whoever draws it.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from harness.processes import worker_environment
from harness.report.plots.chart import Plot
from harness.report.plots.figures import figure, save, style


def draw(plots: Sequence[Plot], target: Path, suffixes: Sequence[str]) -> None:
    """Writes each plot in each format into the folder `target`."""
    with style():
        for plot in plots:
            save(figure(plot.chart), target, plot.name, suffixes)


class Beside:
    """Draws from the start of the context; `finish` waits. A process that fails is replaced by this one."""

    def __init__(self, plots: Sequence[Plot], target: Path, suffixes: Sequence[str]) -> None:
        self._share = plots, target, suffixes
        self._given = tempfile.TemporaryFile()  # noqa: SIM115 (closed at exit)

    def __enter__(self) -> Beside:
        pickle.dump(self._share, self._given)
        self._given.seek(0)
        command = [sys.executable, "-m", "harness.report.plots.parallel"]
        streams = {"stdin": self._given, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, **streams, env=worker_environment(False))
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._given.close()

    def finish(self) -> None:
        if self._process.wait() != 0:
            draw(*self._share)


if __name__ == "__main__":
    draw(*pickle.load(sys.stdin.buffer))
