"""How plots look: one colour an engine everywhere, a line a sampler, a marker an accelerator; and how they are saved.

Colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish; lines and markers carry the rest, so
that print in black and white stays readable. Files are the same to the byte at every run.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from engines.choices import Choice
from engines.errors import ConfigError
from harness.store.atomic import replacing, write_text
from harness.store.results import Contestant, Results, setting_text

INK, FAINT, GRID = "#222222", "#777777", "#cccccc"
"""Colours that the report's dark mode replaces."""
ENGINE_COLOURS = {
    "numpy": "#009e73",
    "numba": "#d55e00",
    "embree": "#0072b2",
    "mitsuba": "#cc79a7",
    "embreex_batch": "#3d5a80",
    "mitsuba_scalar": "#b5838d",
    "dahlquist": "#8c6d31",
}
OTHER_COLOURS = ("#e69f00", "#56b4e9", "#7f3c8d", "#5b6c5d", "#a6192e")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
STYLE: dict[str, Any] = {
    "svg.hashsalt": "raybench",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "savefig.dpi": 160,
    "axes.titlelocation": "left",
    "axes.formatter.useoffset": False,
    "font.family": ["DejaVu Sans", "sans-serif"],
}
FORMATS = ("svg", "png", "pdf")
NO_DATES: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": "raybench"},
    "png": {"Software": "raybench"},
    "pdf": {"CreationDate": None, "Creator": "raybench", "Producer": "raybench"},
}


class Plot(NamedTuple):
    """A drawn figure: file stem, title, what a screen reader says, and its SVG text."""

    name: str
    title: str
    description: str
    svg: str


class Sketch(NamedTuple):
    """A figure that is yet to be drawn: `make` gives None where the results do not allow it."""

    name: str
    title: str
    description: str
    make: Callable[[], Figure | None]


class Look(NamedTuple):
    """How a contestant is drawn."""

    colour: str
    line: Any
    marker: str
    filled: bool
    width: float

    def line_style(self) -> dict[str, Any]:
        face = self.colour if self.filled else "white"
        return {
            "color": self.colour,
            "linestyle": self.line,
            "marker": self.marker,
            "markerfacecolor": face,
            "markeredgecolor": self.colour,
            "linewidth": self.width,
        }


class Palette:
    """Looks of all contestants; depends on the order in which names first appear, so that later ones move none."""

    def __init__(self, results: Results) -> None:
        cells = [contestant.settings for contestant in results.contestants]
        self.engines = engine_colours(cell.engine for cell in results.cells)
        self.samplers = sorted({settings.sampler for settings in cells})
        self.accelerators = sorted({settings.accelerator for settings in cells})
        self.threads = sorted({settings.threads for settings in cells})

    def look(self, contestant: Contestant) -> Look:
        """Engine: colour. Sampler: line. Accelerator: marker. float32: hollow marker. More threads: thicker line."""
        settings = contestant.settings
        return Look(
            self.engines.get(settings.engine, FAINT),
            LINES[self.samplers.index(settings.sampler) % len(LINES)],
            MARKERS[self.accelerators.index(settings.accelerator) % len(MARKERS)],
            settings.precision != "float32",
            min(1.1 + 0.6 * self.threads.index(settings.threads), 3.0),
        )

    def colour(self, engine: str) -> str:
        return self.engines.get(engine, FAINT)

    def key(self, contestants: Sequence[Contestant]) -> list[Line2D]:
        """Legend entries for what looks mean, instead of one entry a curve: only what differs among the contestants."""
        entries: list[Line2D] = []
        kinds: list[tuple[str, dict[str, Any]]] = [
            ("engine", {"linewidth": 2.5, "marker": "", "linestyle": "-"}),
            ("sampler", {"color": INK, "marker": ""}),
            ("accelerator", {"color": INK, "linestyle": "none"}),
            ("threads", {"color": INK, "linestyle": "-", "marker": ""}),
            ("precision", {"color": INK, "linestyle": "none", "marker": "o"}),
        ]
        for axis, fixed in kinds:
            examples = {getattr(c.settings, axis): self.look(c) for c in reversed(contestants)}
            if len(examples) < 2:
                continue
            for value in sorted(examples):
                look: dict[str, Any] = examples[value].line_style() | {"markeredgecolor": INK} | fixed
                if look["markerfacecolor"] != "white" or axis != "precision":
                    look["markerfacecolor"] = INK
                if axis == "threads":
                    label = f"{value} thread{'s' if value != 1 else ''}"
                else:
                    label = setting_text(axis, _short(value, examples))
                entries.append(Line2D([], [], **look, label=label))
        return entries


def _short(value: Any, among: Iterable[Any]) -> Any:
    """A choice by its name alone, without its options, where no other has that name; other values as they are."""
    if not isinstance(value, Choice):
        return value
    return Choice(value.name) if [other.name for other in among].count(value.name) == 1 else value


def engine_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour an engine: its own where it has one, else by the order in which names first appear."""
    others = [name for name in dict.fromkeys(names) if name not in ENGINE_COLOURS]
    return ENGINE_COLOURS | {name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)}


def new_figure(width: float = 7.2, height: float = 4.2) -> Figure:
    """A figure in inches with automatic layout, without pyplot's global state."""
    return Figure(figsize=(width, height), layout="constrained")


def small_multiples(count: int, width: float, height: float, sharey: bool = True) -> tuple[Figure, list[Axes]]:
    """Subplots of `width` x `height` inches, three a row, that share their x axis."""
    columns = min(count, 3)
    rows = math.ceil(count / columns)
    figure = new_figure(max(7.2, width * columns), height * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=sharey, squeeze=False).ravel()
    for spare in grid[count:]:
        spare.remove()
    return figure, list(grid[:count])


def formats() -> tuple[str, ...]:
    """Those of `$RAYBENCH_PLOTS`, for whom drawing takes too long: `svg,png`, say, or `none`. By default all. Where anything is
    drawn, svg is among them: the report shows it.

    Raises ConfigError for what is no format.
    """
    names = [name.strip() for name in os.environ.get("RAYBENCH_PLOTS", ",".join(FORMATS)).split(",")]
    if names == ["none"]:
        return ()
    for name in names:
        if name not in FORMATS:
            expected = f"none, or any of {', '.join(FORMATS)}"
            raise ConfigError(f"$RAYBENCH_PLOTS: {name!r} is no format of a plot; expected: {expected}")
    return tuple(name for name in FORMATS if name in ("svg", *names))


def save(figure: Figure, folder: Path, name: str, suffixes: Sequence[str] = ()) -> str:
    """Writes the figure as svg and in the other `suffixes`, else in `formats()`, and returns the svg text."""
    figure.draw_without_rendering()
    figure.set_layout_engine(None)  # the layout is found; with any engine each format would be drawn twice
    for suffix in (each for each in suffixes or formats() if each != "svg"):
        with replacing(folder / f"{name}.{suffix}", durable=False) as file:
            figure.savefig(file, format=suffix, metadata=NO_DATES[suffix])
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_DATES["svg"], transparent=True)
    write_text(folder / f"{name}.svg", buffer.getvalue())
    return buffer.getvalue()


def log_scales(axis: Axes, x: bool = True, y: bool = False) -> None:
    """Logarithmic scales with plain labels such as 0.01, which are set faster than powers and read as easily."""
    for wanted, scaled, set_scale in ((x, axis.xaxis, axis.set_xscale), (y, axis.yaxis, axis.set_yscale)):
        if wanted:
            set_scale("log")
            scaled.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            scaled.set_minor_formatter(FuncFormatter(partial(_minor_label, scaled)))


def _minor_label(scaled: Axis, value: float, _: int) -> str:
    """2 and 5 of a decade where the axis spans so little that decades alone would leave it nearly bare."""
    low, high = sorted(scaled.get_view_interval())
    few = low > 0 and high < 30 * low
    return f"{value:g}" if few and f"{value:.0e}"[0] in "25" else ""


def file_stem(*words: str) -> str:
    """Words as a file name: letters, digits, `-` and `_` alone."""
    text = "-".join(word for word in words if word)
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in text)
