"""How contestants look: colours, lines, markers and widths; and the names and formats of the files.

Colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish; lines and markers carry the rest, so
that print in black and white stays readable.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from typing import Any

from engines.choices import Choice
from engines.errors import ConfigError
from harness.analysis.model import Group, group_of
from harness.report.plots.chart import FAINT, INK, LINES, MARKERS, Chart, Entry, Look, Subplot
from harness.store.records import Settings
from harness.store.results import Contestant, Results, brief_choice

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
COLOURS = (*list(ENGINE_COLOURS.values())[:4], *OTHER_COLOURS)
"""Of what is no engine."""
AXES = ("engine", "shader", "sampler", "accelerator", "precision", "threads")
"""Settings that a look shows; the first that differs in some race has the colour."""
FORMATS = ("svg", "png", "pdf")
MOST_CURVES = 10
"""More curves than this in one panel are split into facets, and have no entry each in the legend of a file."""


class Palette:
    """Looks of all contestants, from the settings in which they differ.

    Engine: colour. Sampler: line. Accelerator: marker. float32: hollow marker. More threads: thicker line. Where no race has
    two engines, the first other setting that differs in one has the colour. The shader takes the marker where no race has two
    accelerators, else the line where none has two samplers, else nothing.
    """

    def __init__(self, results: Results) -> None:
        self.engines = engine_colours(cell.engine for cell in results.cells)
        self.values = {axis: sorted({getattr(c.settings, axis) for c in results.contestants}) for axis in AXES}
        races: dict[Group, list[Settings]] = {}
        for contestant in results.contestants:
            if contestant.done:
                races.setdefault(group_of(contestant), []).append(contestant.settings)
        differ = [axis for axis in AXES if any(len({getattr(s, axis) for s in race}) > 1 for race in races.values())]
        self.coloured = next(iter(differ), "engine")
        self.marked = "shader" if "shader" in differ and "accelerator" not in differ else "accelerator"
        self.dashed = "shader" if {"shader", "accelerator"} <= {*differ} and "sampler" not in differ else "sampler"

    def look(self, contestant: Contestant) -> Look:
        settings = contestant.settings
        return Look(
            self._colour(settings),
            LINES[self._rank(settings, self.dashed) % len(LINES)],
            MARKERS[self._rank(settings, self.marked) % len(MARKERS)],
            settings.precision != "float32",
            min(1.1 + 0.6 * self._rank(settings, "threads"), 3.0),
        )

    def _colour(self, settings: Settings) -> str:
        if self.coloured == "engine":
            return self.colour(settings.engine)
        return COLOURS[self._rank(settings, self.coloured) % len(COLOURS)]

    def _rank(self, settings: Settings, axis: str) -> int:
        return self.values[axis].index(getattr(settings, axis))

    def colour(self, engine: str) -> str:
        return self.engines.get(engine, FAINT)

    def key(self, contestants: Sequence[Contestant]) -> list[Entry]:
        """Legend entries for what looks mean, instead of one entry a curve: only what differs among the contestants."""
        return [entry for axis in AXES for entry in self._entries(axis, contestants)]

    def colours(self, contestants: Sequence[Contestant]) -> list[tuple[str, str]]:
        """What the colours of curves mean, and the colours."""
        examples = {getattr(c.settings, self.coloured): self.look(c).colour for c in contestants}
        return [(_text(self.coloured, value, examples), colour) for value, colour in sorted(examples.items())]

    def _entries(self, axis: str, contestants: Sequence[Contestant]) -> list[Entry]:
        examples = {getattr(c.settings, axis): self._part(axis, self.look(c)) for c in reversed(contestants)}
        if len(set(examples.values())) < 2:
            return []
        return [Entry(_text(axis, value, examples), look) for value, look in sorted(examples.items())]

    def _part(self, axis: str, look: Look) -> Look:
        """What `axis` decides of a look, the rest plain."""
        colour = look.colour if axis == self.coloured else INK
        marker = look.marker if axis == self.marked else "o" if axis == "precision" else ""
        line = look.line if axis == self.dashed else "none" if marker else "-"
        width = look.width if axis == "threads" else 2.5 if axis == self.coloured else 1.4
        return Look(colour, line, marker, look.filled or axis != "precision", width)


def _text(axis: str, value: Any, among: Iterable[Any]) -> str:
    """A value of a setting in a legend: a choice with the options in which others of its name differ."""
    if axis == "threads":
        return f"{value} thread{'s' if value != 1 else ''}"
    return brief_choice(value, [*among]) if isinstance(value, Choice) else str(value)


def engine_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour an engine: its own where it has one, else by the order in which names first appear."""
    others = [name for name in dict.fromkeys(names) if name not in ENGINE_COLOURS]
    return ENGINE_COLOURS | {name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)}


def formats() -> tuple[str, ...]:
    """Those of `$RAYBENCH_PLOTS`, for whom drawing takes too long: `svg,png`, say, or `none`. By default all. The report needs
    none of them.

    Raises ConfigError for what is no format.
    """
    names = [name.strip() for name in os.environ.get("RAYBENCH_PLOTS", ",".join(FORMATS)).split(",")]
    if names == ["none"]:
        return ()
    for name in names:
        if name not in FORMATS:
            expected = f"none, or any of {', '.join(FORMATS)}"
            raise ConfigError(f"$RAYBENCH_PLOTS: {name!r} is no format of a plot; expected: {expected}")
    return tuple(name for name in FORMATS if name in names)


def file_stem(*words: str) -> str:
    """Words as a file name: letters, digits, `-` and `_` alone."""
    text = "-".join(word for word in words if word)
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in text)


def small_multiples(subplots: Sequence[Subplot], width: float, height: float, **options: Any) -> Chart:
    """A chart of subplots of `width` x `height` inches, three a row; `options` as of `Chart`."""
    columns = min(len(subplots), 3)
    rows = math.ceil(len(subplots) / columns)
    return Chart(subplots, max(7.2, width * columns), height * rows, columns, **options)


def curve_legend(palette: Palette, contestants: Sequence[Contestant]) -> dict[str, Any]:
    """Options of a chart: an entry a curve beside it if they are few, else one a colour, line, marker and width beneath."""
    return {} if len(contestants) <= MOST_CURVES else {"legend": "below", "key": palette.key(contestants)}
