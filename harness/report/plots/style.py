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
from harness.report.plots.chart import FAINT, INK, LINES, MARKERS, Chart, Entry, Look, Subplot
from harness.store.results import Contestant, Results, setting_text

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
FORMATS = ("svg", "png", "pdf")
MOST_CURVES = 10
"""More curves than this in one panel are split into facets, and have no entry each in the legend of a file."""


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

    def key(self, contestants: Sequence[Contestant]) -> list[Entry]:
        """Legend entries for what looks mean, instead of one entry a curve: only what differs among the contestants."""
        entries: list[Entry] = []
        kinds: dict[str, dict[str, Any]] = {
            "engine": {"width": 2.5, "marker": "", "line": "-"},
            "sampler": {"colour": INK, "marker": ""},
            "accelerator": {"colour": INK, "line": "none"},
            "threads": {"colour": INK, "line": "-", "marker": ""},
            "precision": {"colour": INK, "line": "none", "marker": "o"},
        }
        for axis, fixed in kinds.items():
            examples = {getattr(c.settings, axis): self.look(c) for c in reversed(contestants)}
            if len(examples) < 2:
                continue
            for value in sorted(examples):
                look = examples[value]._replace(**fixed)
                if axis != "precision":
                    look = look._replace(filled=True)
                if axis == "threads":
                    label = f"{value} thread{'s' if value != 1 else ''}"
                else:
                    label = setting_text(axis, _short(value, examples))
                entries.append(Entry(label, look))
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
