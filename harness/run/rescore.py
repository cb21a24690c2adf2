"""Metrics again from stored images, after a change of a metric: nothing is rendered, the times stay as measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.image import read_image
from engines.schema.yaml_file import locate
from harness import config, metrics, store
from harness.analysis.targets import automatic_targets
from harness.config import Experiment, Quality
from harness.hashing import digest
from harness.store.records import AnyCell, AnyEvent, Cell, Manifest, Run, Targets


def rescore(folder: Path, overrides: Sequence[str] = (), command: Sequence[str] = ()) -> tuple[int, int]:
    """Appends a new event for every cell with images; (checkpoints scored, checkpoints without an image).

    `overrides` (`quality.epsilon=0.1`) change the quality that targets are set on; they are recorded as a run by
    `command`. Scores under other metric names are kept. Images are float32: a score differs from the first one by some
    1e-6 of itself.
    """
    manifest = store.read_manifest(folder)
    if not manifest.config:
        raise ConfigError(f"{store.MANIFEST} config: is missing: it is not known what was to be measured")
    quality = _quality(store.config_of(manifest), overrides)
    history = store.read_events(folder)
    with store.Events(folder) as events:
        cells, scored, without = _scored(folder, history, quality)
        for cell in cells:
            events.append(cell)
        if overrides:
            latest = store.latest_cells([*history, *cells])
            _record(folder, manifest, quality, events, latest, command)
    return scored, without


def _quality(experiment: Experiment, overrides: Sequence[str]) -> Quality:
    """The quality of the folder's config, with overrides applied."""
    root = locate({"quality": experiment.normalised()["quality"]}, store.MANIFEST, ConfigError)
    for override in overrides:
        root = config.override(root, override)
    return config.read_quality(root)


def _scored(folder: Path, history: Sequence[AnyEvent], quality: Quality) -> tuple[list[Cell], int, int]:
    """Events of cells whose scores have changed; checkpoints scored; checkpoints without an image."""
    references: dict[str, Any] = {}
    changed: list[Cell] = []
    scored = without = 0
    for cell in store.of_kind(store.latest_cells(history).values(), Cell):
        if cell.state not in ("done", "timeout") or not cell.points:
            continue
        key = str(cell.reference_id)
        if key not in references:
            references[key] = store.reference_arrays(folder, key)
        points = []
        for point in cell.points:
            if not point.image:
                without += 1
                points.append(point)
                continue
            file = store.image_file(folder, point.image)
            image = read_image(file)
            if image.shape != references[key].mean.shape:
                raise ConfigError(f"{file}: is of shape {image.shape}: its reference is of {references[key].mean.shape}")
            scores = metrics.measure(image, references[key], quality.epsilon, quality.name)
            points.append(point.replaced(metrics={**point.metrics, **{key: float(value) for key, value in scores.items()}}))
            scored += 1
        if points != list(cell.points):
            changed.append(cell.replaced(points=tuple(points)))
    return changed, scored, without


def _record(
    folder: Path,
    manifest: Manifest,
    quality: Quality,
    events: store.Events,
    latest: Mapping[str, AnyCell],
    command: Sequence[str],
) -> None:
    """The new quality in manifest and events, with its targets; `auto` ones of another metric are resolved now."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    experiment = store.config_of(manifest)
    changed = quality.name != experiment.quality.name
    store.write_manifest(folder, manifest.replaced(config=replace(experiment, quality=quality).normalised()))
    name = manifest.config_name or manifest.name
    events.append(Run(time=now, run_id=digest([now, *command]), command=tuple(command), config_name=name))
    targets = quality.targets or (automatic_targets(store.of_kind(latest.values(), Cell), quality.name) if changed else ())
    if targets:
        events.append(Targets(metric=quality.name, targets=tuple(targets)))
