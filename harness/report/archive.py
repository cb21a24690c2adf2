"""A copy of results small enough to be committed or attached to a paper, from which the report can be made again.

Beside results it holds what `supplement` writes: the experiment, its scenes, how to replay it and citation metadata.

It keeps the first images that a report shows of a scene and shader (`MOST_IMAGES`), as precise as it shows them; what was
concluded from all of them, as an event; of the events what still counts, with numbers to six digits, compressed; and the
references to three digits, in a folder of their own. Of absolute paths (in commands, messages, scenes from elsewhere) the
last part alone is left.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.image import read_image, write_image
from harness import store
from harness.analysis import Analysis, analyse, archived_verdicts, calibration
from harness.report.html.pictures import rounded, shown_images
from harness.report.supplement import FILES, UNSIGNED, Published, clear_supplement, write_supplement
from harness.store import confined, reference_files
from harness.store.records import (
    AnyEvent,
    ArchivedVerdicts,
    Attempt,
    Calibration,
    Cell,
    RayAttempt,
    RayCell,
    Reference,
    Start,
    transformed,
)
from harness.store.results import load_results

DIGITS = 6
MOST_IMAGES = 2
"""Of a scene and shader: that many images at the end of the budget, and as many at equal time."""
MEASURED = ("phases", "counters", "machine", "wall_seconds")
DROPPED = (Start, Attempt, RayAttempt, ArchivedVerdicts, Calibration)
"""Kinds of events that say nothing about what counts, or are written anew."""
FOLDERS = re.compile(r"""(?<![\w./~])/(?:[^\s/'"]+/)+""")
"""The folders of an absolute path."""


def archive(folder: Path, out: Path, most_images: int = MOST_IMAGES, published: Published = UNSIGNED) -> tuple[int, list[str]]:
    """Writes the archive into `out`, where it replaces another one. Returns its bytes, without what `report` makes again, and
    sentences on what a replay would lack.

    `most_images` limits the images of a scene and shader: at least 0 at the end of the budget, as many at equal time.
    `published`: what its authors say of it. Raises `ConfigError`.
    """
    published.check()
    if out.resolve() == folder.resolve():
        raise ConfigError(f"{out}: is the results folder itself: --out must be another")
    if store.events_file(out) and not (out / reference_files.FOLDER).is_dir():
        raise ConfigError(f"{out}: holds results that are no archive: --out must be a new folder, or an archive")
    if not store.events_file(out) and (taken := [name for name in FILES if (out / name).exists()]):
        raise ConfigError(f"{out}: has {' and '.join(taken)} already: --out must be a new folder, or an archive")
    results = load_results(folder)
    analysis = analyse(results)
    kept = {image: store.image_file(folder, image) for image in shown_images(analysis, most_images)}
    _clear(out)
    try:
        _write(analysis, kept, folder, out)
        missing = write_supplement(results, store.read_manifest(out), out, published)
    except BaseException:
        _clear(out)  # half an archive would pass for a whole one
        raise
    return sum(path.stat().st_size for path in out.rglob("*") if path.is_file()), missing


def _clear(out: Path) -> None:
    if store.events_file(out):
        store.clear(out)
        clear_supplement(out)
    shutil.rmtree(out / reference_files.FOLDER, ignore_errors=True)


def _write(analysis: Analysis, kept: Mapping[str, Path], folder: Path, out: Path) -> None:
    with store.Events(out) as events:
        for event in _still_counting(store.read_events(folder)):
            events.append(transformed(_shortened(event, kept, folder, out), without_folders))
        events.append(transformed(archived_verdicts.archived(analysis), _rounded))
        events.append(transformed(calibration.calibrate(analysis), _rounded))
    store.compress(out)
    store.write_manifest(out, transformed(store.read_manifest(folder), without_folders))
    for image, source in kept.items():
        target = confined.inside(out, image, f"{out}: image")
        target.parent.mkdir(parents=True, exist_ok=True)
        write_image(target, rounded(read_image(source)))


def _still_counting(events: Sequence[AnyEvent]) -> list[AnyEvent]:
    """Of each cell the last event, unless it is outdated; all others but those of `DROPPED` kinds."""
    others = [event for event in events if not isinstance(event, (Cell, RayCell, *DROPPED))]
    return [*others, *(cell for cell in store.latest_cells(events).values() if cell.state != "outdated")]


def _shortened(event: AnyEvent, kept: Container[str], folder: Path, out: Path) -> AnyEvent:
    """An event as it stands in the archive."""
    if isinstance(event, Reference):
        reference_files.carry(folder, event, out, small=True)
    if not isinstance(event, (Cell, RayCell)):
        return event
    measured = {name: transformed(getattr(event, name), _rounded) for name in MEASURED if name in event.model_fields_set}
    if isinstance(event, RayCell):
        return event.replaced(**measured, seconds=_rounded(event.seconds))
    points = tuple(point.replaced(image=point.image if point.image and point.image in kept else None) for point in event.points)
    return event.replaced(**measured, points=transformed(points, _rounded))


def without_folders(value: Any) -> Any:
    """A text in which `/folder/x.yaml` is `x.yaml`; other values as they are."""
    return FOLDERS.sub("", value) if isinstance(value, str) else value


def _rounded(value: Any) -> Any:
    """A number to `DIGITS` significant digits; other values as they are."""
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) and math.isfinite(value) else value
