"""Metrics again from stored images, after a change of a metric: nothing is rendered, the times stay as measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from engines.image import read_image
from harness import metrics, store


def rescore(folder: Path) -> tuple[int, int]:
    """Appends a new event for every cell with images; (checkpoints scored, checkpoints without an image).

    Images are float32: a score differs from the first one by some 1e-6 of itself.
    """
    epsilon = float(store.read_manifest(folder)["config"]["quality"]["epsilon"])
    cells = store.latest_cells(store.read_events(folder)).values()
    references: dict[str, Any] = {}
    scored = without = 0
    with store.Events(folder) as events:
        for cell in cells:
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
                scores = metrics.measure(read_image(folder / point["image"]), references[key], epsilon)
                points.append({**point, "metrics": scores})
                scored += 1
            if points != cell["points"]:
                events.append({**cell, "points": points})
    return scored, without
