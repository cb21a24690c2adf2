"""How far the balls of other engines differ from those of Dahlquist's ray tracer, pixel by pixel.

Levels are steps of an 8-bit channel: images are clipped to [0, 1] and multiplied by 255, as the port's frames are stored. A
pixel differs by its worst channel. The reference is the port's own frame; which of its pixels show balls, the port is asked
again, and nothing is compared where it then draws another frame than the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from engines import dahlquist
from harness.analysis import Analysis
from harness.analysis.equivalence import last_pictured
from harness.report.chapter import figures
from harness.report.chapter.document import Paragraph, Part, Section, TablePart
from harness.report.chapter.texts import listed
from harness.report.plots import Picture
from harness.report.plots.figures import new_figure
from harness.report.tables import Column, Table
from harness.store.results import Contestant, Results

CALLS, TIME_ELAPSED = 11, 3000
"""The frame calls after which balls stand as in scenes/dahlquist.yaml."""
VISIBLE = 16
"""Levels by which a pixel has to differ to be counted."""
STORED = 0.125
"""Levels that half precision, in which archives keep images, can take from a pixel: a difference of so little is none."""
SAME = 0.5
"""Levels within which all pixels of two images have to be for them to count as one image."""
DRAWN = 320
"""Pixels along a drawn image, at the most."""
Image = NDArray[np.float64]


class Difference(NamedTuple):
    """`levels` (n,) of the ball pixels of contestants `names`, whose images are the same; `image` (h, w, 3) in levels."""

    names: list[str]
    image: Image
    levels: Image


class Truth(NamedTuple):
    """The port's frame (h, w, 3) in levels, and where it shows balls (h, w)."""

    frame: Image
    balls: NDArray[np.bool_]


def section(analysis: Analysis, named: Sequence[tuple[str, Contestant]], plots: Path) -> Section:
    """Image differences of the contestants with their names: those that have an image of the reference's size."""
    measured = [(name, contestant) for name, contestant in named if contestant.done]
    truth = _truth(analysis.results, [contestant for _, contestant in measured])
    if isinstance(truth, str):
        return Section("Images", [Paragraph([f"Images were not compared: {truth}."])])
    differences, without = _differences(analysis.results, measured, truth)
    parts: list[Part] = []
    if without:
        parts.append(Paragraph([f"No image was kept of {listed(without)}."]))
    if differences:
        parts += [TablePart(_table(truth, differences)), *figures.part(_drawn(truth, differences, plots))]
    return Section("Images", parts)


def _truth(results: Results, contestants: Sequence[Contestant]) -> Truth | str:
    """The port's frame, or why there is none to compare with."""
    ids = {cell.reference_id for contestant in contestants for cell in contestant.done}
    if len(ids) != 1:
        return "they have different references"
    reference = results.reference(ids.pop())
    if reference is None:
        return "the reference is missing"
    height, width, _ = reference.mean.shape
    tracer = dahlquist.Tracer(width, height, engine="numpy", probe=dahlquist.smooth_probe())
    for _ in range(CALLS - 1):
        tracer.animation.step(TIME_ELAPSED)
    frame = tracer.call(TIME_ELAPSED)
    levels = 255 * reference.mean
    if np.abs(levels - frame[..., :3]).max() > SAME:
        return "the reference is not the frame that the port draws of its scene"
    return Truth(levels, frame[..., 3] == dahlquist.SPHERE)


def _differences(results: Results, named: Sequence[tuple[str, Contestant]], truth: Truth) -> tuple[list[Difference], list[str]]:
    """From the smallest difference to the greatest, and the names without an image. Threads change no image."""
    differences: list[Difference] = []
    without = []
    for name in dict.fromkeys(name for name, _ in named):
        image = next((i for n, c in named if n == name and (i := _last_image(results, c)) is not None), None)
        if image is None or image.shape != truth.frame.shape:
            without.append(name)
            continue
        alike = next((d for d in differences if np.abs(d.image - image)[truth.balls].max(initial=0) <= SAME), None)
        if alike is not None:
            alike.names.append(name)
        else:
            levels = np.abs(image - truth.frame).max(axis=2)[truth.balls]
            differences.append(Difference([name], image, np.where(levels > STORED, levels, 0.0)))
    return sorted(differences, key=lambda one: float(one.levels.mean())), without


def _last_image(results: Results, contestant: Contestant) -> Image | None:
    """(h, w, 3) in levels."""
    for cell in contestant.done:
        image = results.image(last_pictured(cell))
        if image is not None:
            return 255 * np.clip(image, 0, 1)
    return None


def _table(truth: Truth, differences: Sequence[Difference]) -> Table:
    table = Table(
        "port_images",
        "Difference from the port's image",
        f"In levels of 255, by the worst channel of a pixel, over the {truth.balls.sum()} pixels "
        f"({100 * truth.balls.mean():.3g} %) of the port's frame that show balls: "
        "behind them the port shows a picture of its own where others see the sky.",
        [
            Column("name", "Engine and accelerator.", title="engine and accelerator"),
            Column("median", "Median difference.", "number"),
            Column("mean", "Mean difference.", "number"),
            Column("high", "99 % of the pixels differ by less.", "number", "99 %"),
            Column("visible", f"Share of pixels that differ by more than {VISIBLE}.", "percent", f"above {VISIBLE}"),
        ],
    )
    for one in differences:
        numbers: dict[str, Any] = {
            "median": float(np.median(one.levels)),
            "mean": float(one.levels.mean()),
            "high": float(np.quantile(one.levels, 0.99)),
            "visible": float(np.mean(one.levels > VISIBLE)),
        }
        table.rows += [{"name": name, **numbers} for name in one.names]
    return table


def _drawn(truth: Truth, differences: Sequence[Difference], plots: Path) -> Picture | None:
    """The port's frame, the image that differs most, and by how much."""
    other = differences[-1]
    if other.levels.max(initial=0) <= SAME:
        return None
    difference = np.abs(other.image - truth.frame).max(axis=2)
    shown = np.where(truth.balls, difference, np.nan)
    step = max(-(-truth.frame.shape[1] // DRAWN), 1)
    figure: Figure = new_figure(7.6, 2.9)
    left, middle, right = figure.subplots(1, 3)
    left.imshow(truth.frame[::step, ::step] / 255)
    middle.imshow(other.image[::step, ::step] / 255)
    scale = right.imshow(shown[::step, ::step], cmap="magma", vmin=0, vmax=64)
    for axis, title in ((left, "the port"), (middle, other.names[0]), (right, "difference on the balls")):
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
    figure.colorbar(scale, ax=right, shrink=0.7, extend="max", label="levels of 255")
    return figures.finished(
        figure,
        plots,
        "port_images",
        f"The port's frame beside the image of {other.names[0]}",
        "Two images of five mirroring balls, and by how many levels they differ.",
    )
