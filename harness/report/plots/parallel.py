"""A second process that draws its share of the figures: `python -m harness.report.plots.parallel`, results in, plots out.

A new interpreter, not a fork: the first process may hold engines with threads of their own. What is drawn is the same
to the byte, whoever draws it.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

from harness.analysis import Analysis
from harness.processes import worker_environment
from harness.report.plots.drawing import draw
from harness.report.plots.style import Plot


class Beside:
    """Draws from the start of the context; `drawn` waits. A process that fails is replaced by this one."""

    def __init__(self, analysis: Analysis, target: Path, first: int, step: int) -> None:
        self._share = analysis, target, first, step
        self._given, self._made = tempfile.TemporaryFile(), tempfile.TemporaryFile()  # noqa: SIM115 (closed at exit)

    def __enter__(self) -> Beside:
        pickle.dump(self._share, self._given)
        self._given.seek(0)
        command = [sys.executable, "-m", "harness.report.plots.parallel"]
        self._process = subprocess.Popen(
            command, stdin=self._given, stdout=self._made, stderr=subprocess.DEVNULL, env=worker_environment(False)
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._given.close()
        self._made.close()

    def drawn(self) -> dict[int, Plot]:
        if self._process.wait() != 0:
            return draw(*self._share)
        self._made.seek(0)
        return pickle.load(self._made)


if __name__ == "__main__":
    pickle.dump(draw(*pickle.load(sys.stdin.buffer)), sys.stdout.buffer)
