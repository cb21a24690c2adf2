"""The error map of an image: relative squared error against a reference of the same view, in false colours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import ConfigError
from engines.image import read_image
from harness.view.interactive_scene import InteractiveScene

EPSILON = 0.01
DECADES = (-5.0, 0.0)
"""Logarithms of the errors at the ends of the colour map, as in reports."""
Pixels = NDArray[np.float32]


def view_of(interactive: InteractiveScene) -> tuple[Any, ...]:
    """What a reference must have in common with an image: scene, camera, moved objects and size."""
    moves = tuple(sorted((key, *offset) for key, offset in interactive.offsets.items()))
    return interactive.scene.source, interactive.scene.camera, moves, interactive.width, interactive.height


@dataclass(frozen=True)
class ErrorReference:
    """`mean` (height, width, 3) is the radiance, `view` the view that it shows, `name` says where it is from."""

    mean: Pixels
    view: tuple[Any, ...]
    name: str

    def error(self, mean: Pixels) -> Pixels:
        """(height, width) relative squared error, the mean of channels: (A - R)^2 / (R^2 + epsilon)."""
        return ((mean - self.mean) ** 2 / (self.mean**2 + EPSILON)).mean(axis=2)


def reference_from_file(path: Path, interactive: InteractiveScene) -> ErrorReference:
    """The radiance of a linear image. Raises `ConfigError` for one of another size, and where `read_image` does."""
    mean = read_image(path)
    if mean.shape != (shape := (interactive.height, interactive.width, 3)):
        size, shown = f"{mean.shape[1]}x{mean.shape[0]}", f"{shape[1]}x{shape[0]}"
        raise ConfigError(f"{path.name}: is {size} pixels; the image is {shown}")
    return ErrorReference(mean.astype(np.float32), view_of(interactive), path.name)


def false_colours(error: Pixels) -> bytes:
    """(height, width, 4) uint8 as bytes; pixels without a finite error are magenta."""
    from harness.report.html.assembly import colour_maps

    stops = np.array(colour_maps()["magma"], np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (np.log10(np.maximum(error, 1e-12)) - DECADES[0]) / (DECADES[1] - DECADES[0])
    finite = np.isfinite(share)
    places = np.where(finite, np.clip(share, 0.0, 1.0), 0.0) * (len(stops) - 1)
    colours = np.stack([np.interp(places, np.arange(len(stops)), stops[:, channel]) for channel in range(3)], axis=2)
    colours[~finite] = (255, 0, 255)
    pixels = np.full((*error.shape, 4), 255, np.uint8)
    pixels[:, :, :3] = colours.round()
    return pixels.tobytes()
