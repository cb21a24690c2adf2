"""What a run says on stderr: a bar with the time left on a terminal, a line a cell elsewhere.

The bar is drawn only between passes: a thread that redraws it would take time from what is being measured.
"""

from __future__ import annotations

from typing import Protocol

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from harness.plan.cells import Cell, Plan
from harness.settings import CellSettings
from harness.store import records

BAR_WIDTH = 10
COLOURS = {"done": "green", "failed": "red", "timeout": "yellow", "skipped": "dim", "outdated": "dim", "queued": "cyan"}


class Listener(Protocol):
    """What follows the progress of a run. Called only while nothing renders."""

    def note(self, text: str) -> None: ...
    def reference(self, name: str, done: int, count: int) -> None: ...
    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None: ...
    def point(self, spp: int, seconds: float, error: float) -> None: ...
    def finished(self, cell: Cell, event: records.AnyCell) -> None: ...
    def verify_job(self, name: str, number: int, total: int) -> None: ...


def describe(cell: Cell) -> str:
    """A cell in a few words; shader and sampler with their options, which may be all that tells two contestants apart."""
    settings = cell.settings
    parts = [cell.scene.name, cell.engine_name, settings.accelerator.name]
    if isinstance(settings, CellSettings):
        parts += [str(settings.shader), str(settings.sampler)]
    elif cell.ray_set is not None:
        parts += [f"{cell.ray_set.kind} rays"]
    parts += [settings.precision or "", f"{settings.threads}t", f"seed {cell.seed}", cell.label or ""]
    return " ".join(filter(None, parts))


def duration(seconds: float) -> str:
    """Seconds as a person says them: 850 ms, 12 s, 3 min 20 s, 2 h 5 min."""
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


class Terminal:
    """A `Listener` that draws on a console; `plan` is for those that show more of it."""

    def __init__(self, console: Console, plan: Plan | None = None) -> None:
        self.console = console
        self._bar = Progress(
            BarColumn(BAR_WIDTH),
            TextColumn("{task.description}", markup=False),
            console=console,
            auto_refresh=False,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None)
        self._left = ""
        self._number, self._total, self._words = 0, 0, ""

    def __enter__(self) -> Terminal:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def note(self, text: str) -> None:
        self.console.print(escape(text), style="yellow", highlight=False, soft_wrap=True)

    def reference(self, name: str, done: int, count: int) -> None:
        self._draw(f"replicates of reference {name}", done, count)
        if not self.console.is_terminal and done in (0, count):
            self.console.print(f"reference {escape(name)}: {'begins' if done == 0 else 'ready'}", highlight=False)

    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None:
        self._number, self._total, self._words = number, total, describe(cell)
        self._left = f"at most {duration(seconds_left)} left"
        self._draw(f"{self._left}: {self._words}", number, total)

    def point(self, spp: int, seconds: float, error: float) -> None:
        self._draw(f"{self._left}: {spp} spp in {duration(seconds)}, {self._words}", self._number, self._total)

    def finished(self, cell: Cell, event: records.AnyCell) -> None:
        state = event.state
        words = f"[{self._number + 1}/{self._total}] {describe(cell)}: {state}"
        if isinstance(event, records.RayCell):
            words += f", {event.passes} passes in {duration(event.seconds)}" if event.passes else ""
        elif event.points:
            words += f", {event.end.spp} spp in {duration(event.end.seconds)}"
        if event.message:
            words += f": {event.message}"
        if not self.console.is_terminal or state != "done":
            self.console.print(
                escape(words), style=None if state == "done" else COLOURS[state], highlight=False, soft_wrap=True
            )

    def verify_job(self, name: str, number: int, total: int) -> None:
        self._draw(f"verify {name}", number, total)
        if not self.console.is_terminal:
            self.console.print(f"verify [{number + 1}/{total}] {name}", markup=False, highlight=False)

    def _draw(self, words: str, done: int, total: int) -> None:
        """Draws the bar with a line of text, cut to the width of the terminal: rich would shorten the counts first."""
        line = Text(f"{done}/{total} {words}")
        line.truncate(self.console.width - BAR_WIDTH - 1, overflow="ellipsis")
        self._bar.update(self._task, description=line.plain, completed=done, total=total)
        if self.console.is_terminal:
            self._bar.refresh()
