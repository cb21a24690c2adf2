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


def rescore(folder: Path, overrides: Sequence[str] = (), command: Sequence[str] = ()) -> tuple[int, int]:
    """Appends a new event for every cell with images; (checkpoints scored, checkpoints without an image).

    `overrides` (`quality.epsilon=0.1`) change the quality that targets are set on; they are recorded as a run by
    `command`. Scores under other metric names are kept. Images are float32: a score differs from the first one by some
    1e-6 of itself.
    """
    manifest = store.read_manifest(folder)
    if not manifest.get("config"):
        raise ConfigError(f"{store.MANIFEST} config: is missing: it is not known what was to be measured")
    experiment = store.config_of(manifest)
    quality = _quality(experiment, overrides)
    history = store.read_events(folder)
    with store.Events(folder) as events:
        cells, scored, without = _scored(folder, history, quality)
        for cell in cells:
            events.append(cell)
        if overrides:
            latest = {**store.latest_cells(history), **{cell["cell_id"]: cell for cell in cells}}
            manifest["config"] = replace(experiment, quality=quality).normalised()
            _record(manifest, quality.name != experiment.quality.name, quality, events, latest, command)
            store.write_json(folder / store.MANIFEST, manifest)
    return scored, without


def _quality(experiment: Experiment, overrides: Sequence[str]) -> Quality:
    """The quality of the folder's config, with overrides applied."""
    root = locate({"quality": experiment.normalised()["quality"]}, store.MANIFEST, ConfigError)
    for override in overrides:
        root = config.override(root, override)
    return config.read_quality(root)


def _scored(folder: Path, history: Sequence[dict[str, Any]], quality: Quality) -> tuple[list[dict[str, Any]], int, int]:
    """Events of cells whose scores have changed; checkpoints scored; checkpoints without an image."""
    references: dict[str, Any] = {}
    changed: list[dict[str, Any]] = []
    scored = without = 0
    for cell in store.latest_cells(history).values():
        if cell["state"] not in ("done", "timeout") or not cell["points"]:
            continue
        key = cell["reference_id"]
        if key not in references:
            references[key] = store.reference_arrays(folder, key)
        points = []
        for point in cell["points"]:
            if not point["image"]:
                without += 1
                points.append(point)
                continue
            file = store.image_file(folder, point["image"])
            image = read_image(file)
            if image.shape != references[key].mean.shape:
                raise ConfigError(f"{file}: is of shape {image.shape}: its reference is of {references[key].mean.shape}")
            scores = metrics.measure(image, references[key], quality.epsilon, quality.metric)
            points.append({**point, "metrics": {**point["metrics"], **scores}})
            scored += 1
        if points != cell["points"]:
            changed.append({**cell, "points": points})
    return changed, scored, without


def _record(
    manifest: Mapping[str, Any],
    changed: bool,
    quality: Quality,
    events: store.Events,
    latest: Mapping[str, Mapping[str, Any]],
    command: Sequence[str],
) -> None:
    """The new quality as events, with its targets; `auto` ones of a metric that has `changed` are resolved now."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    events.append(
        {
            "event": "run",
            "time": now,
            "run_id": digest([now, *command]),
            "command": list(command),
            "config_name": manifest.get("config_name", manifest.get("name")),
        }
    )
    targets = list(quality.targets or ()) or (automatic_targets(latest.values(), quality.name) if changed else [])
    if targets:
        events.append({"event": "targets", "metric": quality.name, "targets": targets})
