"""The figure by which papers compare renderers: the reference with marked crops, each contestant's crops with their errors, and
error over time."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from engines import tonemap
from engines.errors import ConfigError
from engines.image import write_image
from engines.packages import install_extra
from harness.metrics import Reference, as_error, measure, metric_title
from harness.report.moments import Moment
from harness.report.plots.chart import FAINT, INK, LINES
from harness.report.plots.curves import error_label
from harness.report.plots.figures import log_scales
from harness.report.plots.style import Palette, file_stem
from harness.report.tables.model import number_text
from harness.store.records import Point
from harness.store.results import Contestant, Results, point_error

MOST_CONTESTANTS = 6
"""As many as a page is wide enough for, unless more are asked for."""
CROP_COLOURS = ("#e41a1c", "#1b75bc", "#ff9900", "#4daf4a", "#984ea3")
GAP, HEADING, LABEL, PLOT = 0.05, 0.66, 0.13, 1.75
"""Inches: between pictures, above them, below a crop, and the width of the plot."""
NAME_SIZE, SMALL_SIZE = 6.5, 5.5
"""Points of names, and of all else."""
Image = NDArray[np.float64]


class Crop(NamedTuple):
    """A part of an image, in pixels from its upper left corner."""

    x: int
    y: int
    width: int
    height: int

    def of(self, image: Image) -> Image:
        """The part of `image` (h, w, 3)."""
        return image[self.y : self.y + self.height, self.x : self.x + self.width]


class Taken(NamedTuple):
    """A contestant's image (h, w, 3) at a checkpoint of its first block."""

    contestant: Contestant
    point: Point
    image: Image


def crop_of(text: str) -> Crop:
    """A crop from `x,y,width,height`. Raises `ConfigError`."""
    parts = text.split(",")
    if len(parts) != 4 or not all(part.strip().isdecimal() for part in parts) or min(map(int, parts[2:])) < 1:
        raise ConfigError(f"--crops {text}: expected x,y,width,height in pixels, as 40,60,32,32")
    return Crop(*map(int, parts))


def taken_images(results: Results, scene: str, moment: Moment, names: Sequence[str] = ()) -> list[Taken]:
    """The images of contestants of `scene` at a moment: of those of `names`, in that order, or of all by falling error, at most
    `MOST_CONTESTANTS`.

    Raises `ConfigError` for an unknown scene or name, without images, and where images have different references or sizes.
    """
    if scene not in results.scenes:
        raise ConfigError(f"{results.folder}: scene {scene!r} is not among its scenes: {', '.join(results.scenes)}")
    measured = {c.name: c for c in results.of_scene(scene) if not c.settings.label}
    for name in names:
        if name not in measured:
            raise ConfigError(f"--contestant {name!r}: {scene} has {', '.join(measured)}")
    found = [taken for c in ([measured[name] for name in names] or measured.values()) if (taken := _taken(results, c, moment))]
    if not found:
        raise ConfigError(f"{results.folder}: {scene} has no image {moment} (an experiment keeps them with `images: all`)")
    if len({(taken.contestant.done[0].reference_id, taken.image.shape) for taken in found}) > 1:
        raise ConfigError(f"{scene}: its contestants have different references or sizes: choose those of one by --contestant")
    if names:
        return found
    return sorted(found, key=lambda taken: -point_error(taken.point, results.metric)[0])[-MOST_CONTESTANTS:]


def _taken(results: Results, contestant: Contestant, moment: Moment) -> Taken | None:
    point = moment.of([point for point in contestant.done[0].points if point.image])
    image = results.image(point)
    return Taken(contestant, point, image) if point is not None and image is not None else None


def chosen_crops(reference: Image, count: int = 2) -> list[Crop]:
    """Squares of a fifth of the image's shorter side with the most contrast in display values, which do not overlap."""
    grey = tonemap.to_bitmap(reference).mean(axis=2)
    side = max(min(grey.shape) // 5, 1)
    places = [
        Crop(x, y, side, side)
        for y in range(0, grey.shape[0] - side + 1, max(side // 2, 1))
        for x in range(0, grey.shape[1] - side + 1, max(side // 2, 1))
    ]
    chosen: list[Crop] = []
    for crop in sorted(places, key=lambda crop: -float(crop.of(grey).std())):
        if len(chosen) < count and all(abs(crop.x - c.x) >= side or abs(crop.y - c.y) >= side for c in chosen):
            chosen.append(crop)
    return chosen


def reference_of(results: Results, taken: Sequence[Taken]) -> Reference:
    """The reference that the images have in common. Raises `ConfigError` where it is missing or damaged."""
    name = taken[0].contestant.done[0].reference_id
    found = results.reference(name)
    if found is None or found.mean.shape != taken[0].image.shape:
        raise ConfigError(f"{results.folder}: the reference {name} is missing or damaged")
    return found


def comparison_figure(
    results: Results,
    taken: Sequence[Taken],
    reference: Reference,
    crops: Sequence[Crop],
    *,
    tone: str = "srgb",
    exposure: float = 0.0,
    width: float = 7.2,
    with_plot: bool = True,
) -> Figure:
    """The figure, `width` inches wide; call it inside `figures.style()`.

    All pictures share the tone mapper `tone`, one of `engines.tonemap`, after an exposure in stops. The error of a crop is the
    results' metric over its pixels. Raises `ConfigError` for a crop that is not inside the image.
    """
    height, image_width = reference.mean.shape[:2]
    for crop in crops:
        if crop.x + crop.width > image_width or crop.y + crop.height > height:
            raise ConfigError(f"--crops {','.join(map(str, crop))}: the image has {image_width} x {height} pixels")
    shapes = [crop.height / crop.width for crop in crops]
    columns, aspect = len(taken) + 1, image_width / height
    plot = PLOT + 0.5 if with_plot else 0.0
    room = width - plot - columns * GAP - aspect * (LABEL + GAP) * len(crops)
    side = room / (columns + aspect * sum(shapes))
    if side < 0.25:
        raise ConfigError(f"{columns - 1} contestants do not fit into {width:g} inches: choose fewer, or a larger --width")
    below = sum(side * shape + LABEL + GAP for shape in shapes) - LABEL - GAP
    figure = Figure(figsize=(width, below + HEADING + 2 * LABEL))

    def axes(x: float, y: float, wide: float, high: float) -> Axes:
        """Inches from the upper left corner of the figure."""
        total = float(figure.get_figheight())
        return figure.add_axes((x / width, 1 - (y + high) / total, wide / width, high / total))

    def show(axis: Axes, image: Image) -> None:
        axis.imshow(tonemap.to_bitmap(image * 2.0**exposure, tone), interpolation="nearest", aspect="auto")
        axis.set(xticks=[], yticks=[])
        axis.grid(visible=False)
        for spine in axis.spines.values():
            spine.set_visible(False)

    whole = axes(0, HEADING, below * aspect, below)
    show(whole, reference.mean)
    for crop, colour in zip(crops, CROP_COLOURS * len(crops), strict=False):
        whole.add_patch(Rectangle((crop.x - 0.5, crop.y - 0.5), crop.width, crop.height, fill=False, ec=colour, lw=1.2))
    words = f"error: {metric_title(results.metric)}\nreference: {reference.spp} spp"
    whole.text(0, -0.03, words, transform=whole.transAxes, va="top", fontsize=SMALL_SIZE, color=FAINT)
    errors = [[_error(results, t.image, reference, crop) for t in taken] for crop in (None, *crops)]
    left = below * aspect + GAP
    for column, one in enumerate([*taken, None]):
        top = HEADING
        for row, (crop, shape) in enumerate(zip(crops, shapes, strict=True)):
            axis = axes(left + column * (side + GAP), top, side, side * shape)
            show(axis, crop.of(one.image if one else reference.mean))
            colour = CROP_COLOURS[row % len(CROP_COLOURS)]
            axis.add_patch(Rectangle((0, 0), 1, 1, transform=axis.transAxes, fill=False, ec=colour, lw=1.6))
            if one:
                best = errors[row + 1][column] == min(errors[row + 1])
                _text(axis, number_text(errors[row + 1][column]), -0.02 / (side * shape), "top", INK, bold=best)
            if row == 0:
                _heading(axis, side, side * shape, one, errors[0][column] if one else None, min(errors[0]))
            top += side * shape + LABEL + GAP
    if with_plot:
        _plot(axes(width - PLOT - 0.05, HEADING, PLOT, below), results, taken)
    return figure


def _error(results: Results, image: Image, reference: Reference, crop: Crop | None) -> float:
    """The results' metric as an error, over a crop or the whole."""
    if crop is not None:
        parts = (crop.of(getattr(reference, name)) for name in ("mean", "half_1", "half_2", "variance"))
        image, reference = crop.of(image), Reference(*parts, spp=reference.spp)
    scores = measure(image, reference, results.epsilon)
    if results.metric not in scores:
        raise ConfigError(f"{results.metric} cannot be measured here: {install_extra(results.metric)}")
    return as_error(results.metric, scores.get(f"{results.metric}_corrected", scores[results.metric]))


def _heading(axis: Axes, wide: float, high: float, taken: Taken | None, error: float | None, least: float) -> None:
    """Name, samples and seconds, and the error of the whole image, above a crop of `wide` x `high` inches."""
    lines = textwrap.wrap(taken.contestant.name if taken else "reference", max(int(wide * 72 / (0.56 * NAME_SIZE)), 6))
    if taken is None or error is None:
        _text(axis, "\n".join(lines), 1 + 0.04 / high, "bottom", INK, NAME_SIZE)
        return
    place = f"{taken.point.spp} spp, {number_text(taken.point.seconds)} s"
    _text(axis, number_text(error), 1 + 0.03 / high, "bottom", INK, bold=error == least)
    _text(axis, place, 1 + 0.13 / high, "bottom", FAINT)
    _text(axis, "\n".join(lines), 1 + 0.23 / high, "bottom", INK, NAME_SIZE)


def _text(axis: Axes, text: str, y: float, at: str, colour: str, size: float = SMALL_SIZE, bold: bool = False) -> None:
    weight: Any = "bold" if bold else "normal"
    axis.text(0.5, y, text, transform=axis.transAxes, ha="center", va=at, fontsize=size, color=colour, fontweight=weight)


def _plot(axis: Axes, results: Results, taken: Sequence[Taken]) -> None:
    """Error over seconds of the first block; what was taken is marked."""
    palette = Palette(results)
    drawn: set[tuple[str, Any]] = set()
    for one in taken:
        points = one.contestant.done[0].points
        look = palette.look(one.contestant)
        if (look.colour, look.line) in drawn:  # they differ in what this small plot does not show
            look = look._replace(line=next((line for line in LINES if (look.colour, line) not in drawn), look.line))
        drawn.add((look.colour, look.line))
        seconds, errors = [p.seconds for p in points], [point_error(p, results.metric)[0] for p in points]
        axis.plot(seconds, errors, color=look.colour, linestyle=look.line, linewidth=1.0, label=one.contestant.name)
        error, _ = point_error(one.point, results.metric)
        axis.plot([one.point.seconds], [error], marker="o", markersize=3, color=look.colour)
    log_scales(axis, True, True)
    axis.tick_params(labelsize=SMALL_SIZE, length=2)
    axis.set_xlabel("seconds", fontsize=SMALL_SIZE, labelpad=1)
    axis.set_ylabel(error_label(results.metric), fontsize=SMALL_SIZE, labelpad=1)
    axis.legend(fontsize=SMALL_SIZE, loc="lower center", bbox_to_anchor=(0.5, 1.0), handlelength=1.5, borderaxespad=0.2)


def write_crops(folder: Path, taken: Sequence[Taken], reference: Reference, crops: Sequence[Crop]) -> list[Path]:
    """Writes each crop as an EXR of linear radiance, `crop1-<contestant>.exr`, and returns the paths."""
    written = []
    for number, crop in enumerate(crops, 1):
        for name, image in [("reference", reference.mean), *((t.contestant.name, t.image) for t in taken)]:
            path = folder / f"crop{number}-{file_stem(*name.split())}.exr"
            write_image(path, np.ascontiguousarray(crop.of(image)))
            written.append(path)
    return written
