"""A table for a paper: one value of a results folder, with any two settings as its rows and columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from engines.errors import ConfigError, UnknownName
from harness.analysis import Analysis
from harness.analysis.columns import Column, Table, estimate_of
from harness.analysis.model import Verdict
from harness.metrics import as_error, error_words, metric_title
from harness.report.moments import Moment
from harness.report.tables.by_axis import why_blank
from harness.report.tables.model import csv_text, html_rows, latex_tabular, markdown_rows
from harness.statistics import Estimate, find_crossing, geometric_interval
from harness.statistics.intervals import NOTHING
from harness.statistics.quality import reading_of, time_to_quality
from harness.store.results import AXES, CHOICES, Contestant, brief_choice, curve_of, point_error, setting_text

TARGET = "target"
SETTINGS = ("scene", "contestant", *(axis for axis in AXES if axis != "label"), TARGET)
"""What may be rows or columns, beside every option of a shader, sampler or accelerator."""
INTERVAL = "geometric mean over seeds, in brackets its 95 % interval"
NO_MEAN = "the values of its seeds have no geometric mean"
NOISE = "they are smaller than the noise of the reference, which is taken out of them"


class Asked(NamedTuple):
    """`value` is ratio, seconds, error or spp; `rows` and `columns` are names of settings, `where` the values that others must
    have. `moment` is None for a value at a target."""

    value: str
    rows: str = "scene"
    columns: str = "contestant"
    where: Mapping[str, str] = {}
    moment: Moment | None = None


class _Item(NamedTuple):
    """A contestant, at a target or a moment: its settings as texts, and its value or `why` it has none."""

    settings: Mapping[str, str]
    found: Estimate
    why: str = ""
    measured: bool = True
    flags: str = ""
    baseline: str = ""


def paper_table(analysis: Analysis, asked: Asked) -> Table:
    """The table, whose note says what its numbers are and why some are missing; A/A twins are left out.

    Raises `ConfigError` for an unknown setting, where nothing has the settings of `where`, and where a cell of the table has
    several contestants or targets: it names the settings in which these differ.
    """
    if asked.rows == asked.columns:
        raise ConfigError(f"table: rows and columns are both {asked.rows}: two different settings are expected")
    if asked.value == "ratio" and asked.moment is not None:
        raise ConfigError("table: a ratio is one of seconds to a target: --target is expected, not --at")
    if asked.value == "error" and asked.moment is None:
        asked = asked._replace(moment=Moment())
    if asked.moment is None and not analysis.results.targets:
        raise ConfigError(f"{analysis.results.folder}: has no targets: choose a moment by --at")
    if asked.moment is not None and TARGET in (asked.rows, asked.columns, *asked.where):
        raise ConfigError(
            f"table: {asked.value} {asked.moment} depends on no target: seconds, spp and ratio are had at a target"
        )
    items = _selected(_items(analysis, asked), asked)
    cells = _cells(items, asked)
    rows, columns = (_in_order(item.settings[key] for item in items) for key in (asked.rows, asked.columns))
    kind = "ratio" if asked.value == "ratio" else "estimate"
    return Table(
        "table",
        asked.value,
        " ".join([_meaning(analysis, asked, items), *_notes(list(cells.values())), *_not_measured(cells, rows, columns)]),
        [
            Column(asked.rows, "The setting of the rows.", "text", asked.rows),
            *(Column(text, f"{asked.value} where {asked.columns} is {text}.", kind, text) for text in columns),
        ],
        [_row(asked.rows, row, {text: cells[row, text] for text in columns if (row, text) in cells}, columns) for row in rows],
    )


def _row(key: str, row: str, items: Mapping[str, _Item], columns: Sequence[str]) -> dict[str, Any]:
    """A row with its values by column; `blank` says why cells have none."""
    why = {text: items[text].why if text in items else "not measured" for text in columns}
    return {key: row, **{text: item.found for text, item in items.items()}, "blank": {k: v for k, v in why.items() if v}}


def conditions(texts: Iterable[str], target: float | None) -> dict[str, str]:
    """Setting -> value, from texts `setting=value` and a target. Raises `ConfigError`."""
    found = {} if target is None else {TARGET: f"{target:g}"}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals and value):
            raise ConfigError(f"--where {text}: expected setting=value, as sampler=sobol")
        if key in found:
            raise ConfigError(f"--where {text}: {key} has a value already: {found[key]}")
        found[key] = value
    return found


def _items(analysis: Analysis, asked: Asked) -> list[_Item]:
    verdicts = {verdict.contestant: verdict for verdict in analysis.verdicts}
    contestants = [c for c in analysis.results.contestants if not c.settings.label]
    texts = _settings_of(contestants)
    found = []
    for contestant in contestants:
        verdict = verdicts.get(contestant)
        for target in analysis.results.targets if asked.moment is None else [None]:
            of_target = {} if target is None else {TARGET: f"{target:g}"}
            found.append(_item(analysis, asked, contestant, verdict, target)._replace(settings=texts[contestant] | of_target))
    return found


def _settings_of(contestants: Sequence[Contestant]) -> dict[Contestant, dict[str, str]]:
    """The settings of each as texts; of choices the name with those options in which they differ, and each option by name."""
    choices = {axis: [getattr(c.settings, axis) for c in contestants] for axis in CHOICES}
    found = {}
    for contestant in contestants:
        settings = contestant.settings
        of = {"scene": settings.scene, "contestant": contestant.name}
        of |= {axis: setting_text(axis, getattr(settings, axis)) for axis in SETTINGS if axis in AXES}
        for axis in CHOICES:
            choice = getattr(settings, axis)
            of |= {f"{axis}.{name}": str(value) for name, value in choice.options.items()}
            of[axis] = brief_choice(choice, choices[axis])
        found[contestant] = of
    return found


def _item(analysis: Analysis, asked: Asked, one: Contestant, verdict: Verdict | None, target: float | None) -> _Item:
    """Without settings, which the caller adds."""
    if verdict is None:
        states = ", ".join(dict.fromkeys(cell.state for cell in one.cells))
        return _Item({}, NOTHING, f"not measured ({states})", measured=False)
    flags = ", ".join(verdict.warnings)
    if target is None:
        return _at_moment(analysis, asked, one)._replace(flags=flags)
    row = analysis.at(one, target)
    if asked.value == "ratio":
        if row.no_ratio:
            if row.baseline or verdict.disqualified:
                return _Item({}, NOTHING, row.no_ratio, flags=flags)
            return _Item({}, Estimate(1.0, 1.0, 1.0, 0), flags=flags, baseline=one.name)
        return _Item({}, estimate_of(row, "ratio"), why_blank(row), flags=flags, baseline=row.baseline)
    found = estimate_of(row, "seconds") if asked.value == "seconds" else _samples(analysis, one, target)
    return _Item({}, found, NO_MEAN if math.isnan(found.value) else "", flags=flags)


def _samples(analysis: Analysis, one: Contestant, target: float) -> Estimate:
    """Samples per pixel to a target, read as times to it are."""
    results = analysis.results
    curves = [curve_of(cell.points, results.metric, cell.smooth_sampler, cell.reproducible) for cell in one.runs]
    reading, error = reading_of([curve for curve in curves if curve.samples.size]), as_error(results.metric, target)
    found = time_to_quality([find_crossing(curve.samples, curve.error, curve.se, error, reading) for curve in curves])
    return Estimate(found.seconds, found.low, found.high, found.seeds)


def _at_moment(analysis: Analysis, asked: Asked, one: Contestant) -> _Item:
    assert asked.moment is not None
    points = [asked.moment.of(cell.points) for cell in one.done]
    known = [point for point in points if point is not None]
    if len(known) < len(points):
        return _Item({}, NOTHING, f"no checkpoint {asked.moment} in {len(points) - len(known)} of {len(points)} seeds")
    value_of = {
        "error": lambda point: point_error(point, analysis.results.metric)[0],
        "seconds": lambda point: point.seconds,
        "spp": lambda point: float(point.spp),
    }
    values = [value_of[asked.value](point) for point in known]
    found = geometric_interval(values)
    if not math.isnan(found.value):
        return _Item({}, found)
    below = sum(value < 0 for value in values)
    return _Item({}, found, f"errors of {below} of {len(values)} seeds are below 0: {NOISE}" if below else NO_MEAN)


def _selected(items: Sequence[_Item], asked: Asked) -> list[_Item]:
    """Those that `where` asks for, their settings with rows and columns under the names that were asked for."""
    names = {key: _full_name(key, items) for key in (asked.rows, asked.columns, *asked.where)}
    left = [
        item._replace(settings={**item.settings, **{k: item.settings.get(n, "–") for k, n in names.items()}}) for item in items
    ]
    for key, value in asked.where.items():
        known = list(dict.fromkeys(item.settings[key] for item in left))
        left = [item for item in left if _is(item.settings[key], value)]
        if not left:
            raise ConfigError(f"--where {key}={value}: {key} is {' or '.join(known)}")
    return left


def _full_name(key: str, items: Sequence[_Item]) -> str:
    """The name of a setting; an option may be written without its choice. Raises `ConfigError`."""
    known = dict.fromkeys(name for item in items for name in item.settings)
    options = [name for name in known if name.partition(".")[2] == key]
    if key in known:
        return key
    if len(options) > 1:
        raise ConfigError(f"table: {key} is an option of several choices: {' or '.join(options)} is expected")
    if not options:
        raise UnknownName("setting", key, known)
    return options[0]


def _is(text: str, value: str) -> bool:
    """Whether a setting has a value: numbers by their size, choices also by their name alone."""
    try:
        return float(text) == float(value)
    except ValueError:
        return value in (text, text.partition("(")[0])


def _cells(items: Sequence[_Item], asked: Asked) -> dict[tuple[str, str], _Item]:
    """(row, column) -> its only item. One that was not measured gives way to one that was."""
    groups: dict[tuple[str, str], list[_Item]] = {}
    for item in items:
        groups.setdefault((item.settings[asked.rows], item.settings[asked.columns]), []).append(item)
    found = {}
    for (row, column), group in groups.items():
        measured = [item for item in group if item.measured] or group[:1]
        if len(measured) > 1:
            raise ConfigError(_ambiguous(f"{row}, {column}", measured, asked))
        found[row, column] = measured[0]
    return found


def _ambiguous(where: str, items: Sequence[_Item], asked: Asked) -> str:
    taken = {asked.rows, asked.columns, "contestant", *asked.where}
    values = {
        key: list(dict.fromkeys(item.settings.get(key, "–") for item in items))
        for key in dict.fromkeys(name for item in items for name in item.settings)
        if key not in taken
    }
    varied = {key: found for key, found in values.items() if len(found) > 1}
    whole = {key for key in varied if "." not in key}
    shown = {key: found for key, found in varied.items() if key in whole or key.partition(".")[0] not in whole}
    shown = shown or {"contestant": list(dict.fromkeys(item.settings["contestant"] for item in items))}
    words = "; ".join(f"{key}: {', '.join(found)}" for key, found in shown.items())
    first, found = next(iter(shown.items()))
    option = f"--target {found[-1]}" if first == TARGET else f"--where '{first}={found[0]}'"
    return f"table: {where}: {len(items)} values, which differ in {words}: choose one, as {option}, or make it rows or columns"


def _in_order(texts: Iterable[str]) -> list[str]:
    """Each once: numbers by size, names as they come."""
    found = list(dict.fromkeys(texts))
    try:
        return sorted(found, key=float)
    except ValueError:
        return found


def _meaning(analysis: Analysis, asked: Asked, items: Sequence[_Item]) -> str:
    """What the numbers are."""
    metric = metric_title(analysis.results.metric)
    targets = list(dict.fromkeys(item.settings[TARGET] for item in items)) if asked.moment is None else []
    until = f"until {metric} is {targets[0]}" if len(targets) == 1 else f"until {metric} is at the target"
    return {
        "ratio": f"Seconds of the baseline over those of a contestant, {until}: above 1 is faster; {INTERVAL}.",
        "seconds": f"Seconds of rendering {asked.moment or until}; {INTERVAL}.",
        "spp": f"Samples per pixel {asked.moment or until}; {INTERVAL}.",
        "error": f"{metric} {asked.moment}, {error_words(analysis.results.metric)}; {INTERVAL}.",
    }[asked.value]


def _notes(items: Sequence[_Item]) -> list[str]:
    """Sentences on baselines, on what has no value, and on what has flags."""
    baselines = _named((item.baseline, item) for item in items)
    missing = _named((item.why, item) for item in items)
    flagged = _named((item.flags, item) for item in items if not item.why)
    return [
        *(f"Baseline{f' of {names}' if len(baselines) > 1 else ''}: {name}." for name, names in baselines.items()),
        *(f"{names}: {reason}." for reason, names in missing.items()),
        *(f"{names}: flagged ({flags})." for flags, names in flagged.items()),
    ]


def _not_measured(cells: Mapping[tuple[str, str], _Item], rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    """A sentence on the cells of the table for which there is no contestant, if there are any."""
    empty = {row: found for row in rows if (found := [column for column in columns if (row, column) not in cells])}
    names = "; ".join(f"{row} with {', '.join(found)}" for row, found in empty.items())
    return [f"Not measured: {names}."] if empty else []


def _named(items: Iterable[tuple[str, _Item]]) -> dict[str, str]:
    """Text -> the contestants for which it stands, with their scenes."""
    found: dict[str, dict[str, list[str]]] = {}
    for text, item in items:
        if text:
            found.setdefault(text, {}).setdefault(item.settings["scene"], []).append(item.settings["contestant"])
    return {
        text: "; ".join(f"{', '.join(dict.fromkeys(names))} on {scene}" for scene, names in scenes.items())
        for text, scenes in found.items()
    }


def latex_for_paper(table: Table) -> str:
    """A plain tabular; what its numbers are is a comment above it."""
    return f"% {table.note}\n{latex_tabular(table)}"


def markdown_for_paper(table: Table) -> str:
    """The table, and below it what its numbers are."""
    return f"{markdown_rows(table)}\n{table.note}\n"


FORMATS = {"latex": latex_for_paper, "markdown": markdown_for_paper, "csv": csv_text, "html": html_rows}
SUFFIXES = {".tex": "latex", ".md": "markdown", ".csv": "csv", ".html": "html"}
