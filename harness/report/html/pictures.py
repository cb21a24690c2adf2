"""Images for the report's viewer: radiance as compressed half floats, and crops at equal time as PNG."""

from __future__ import annotations

import base64
import math
import zlib
from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.film import to_bitmap
from engines.image import png_bytes
from harness.analysis import Analysis, Verdict
from harness.analysis.axes import others
from harness.metrics import Reference, higher_is_better, metric_title
from harness.report.plots.panels import Panel, panels
from harness.report.tables.model import number_text
from harness.store.records import Point
from harness.store.results import Results, point_error

MOST_PICTURES = 9
"""As many as there are number keys; the reference is key 0."""
BYTES_PER_PIXEL = 6.0
"""What a pixel of a noisy picture takes in base64."""
CROP = 48
"""Pixels along the side of an equal-time crop."""
MOST_CROPS = 24
NOT_KEPT = "its image was not kept (an archive keeps a few of each scene)"
Image = NDArray[np.float64]


class Crop(NamedTuple):
    """A part of an image at nearly the same time as others: PNG data address, name and true time, spp and error."""

    address: str
    name: str
    caption: str


class PictureGroup(NamedTuple):
    """A panel's pictures: `payload` is the viewer's JSON, `crops` start with the reference."""

    title: str
    payload: dict[str, Any]
    crops: list[Crop]
    crop_seconds: float


class Shown(NamedTuple):
    """A contestant's picture at a checkpoint."""

    verdict: Verdict
    point: Point
    image: Image


class Selection(NamedTuple):
    """The pictures by one rule, which `words` says, and (name, reason) of the contestants without one."""

    words: str
    shown: list[Shown]
    missing: list[tuple[str, str]]


def picture_groups(analysis: Analysis, budget_bytes: float) -> list[PictureGroup]:
    """The pictures of every panel that has some, scaled down by whole factors until all fit into the budget."""
    chosen = [(panel, selections(analysis.results, panel)) for panel in panels(analysis)]
    chosen = [(panel, found) for panel, found in chosen if found["last"].shown]
    pixels = 0
    for _, found in chosen:
        images = {shown.point.image: shown.image for selection in found.values() for shown in selection.shown}
        height, width = next(iter(images.values())).shape[:2]
        pixels += (len(images) + 1) * height * width
    factor = max(math.ceil(math.sqrt(pixels * BYTES_PER_PIXEL / max(budget_bytes, 1.0))), 1)
    return [_group(analysis.results, panel, found, factor) for panel, found in chosen]


def shown_images(analysis: Analysis, most: int = MOST_CROPS) -> set[str]:
    """The stored images that an archive keeps for its report, by their paths in the results folder: of each panel at most the
    first `most` at the last checkpoint, and as many at equal time. Those at equal samples are what these have in common."""
    found: set[str] = set()
    for panel in panels(analysis):
        found |= {str(shown.point.image) for shown in selections(analysis.results, panel)["last"].shown[:most]}
        found |= {str(point.image) for _, point in _at_equal_time(analysis.results, panel)[1][:most]}
    return found


def selections(results: Results, panel: Panel) -> dict[str, Selection]:
    """`last`, `time` and `samples`: pictures at the last checkpoint, at equal time and at equal samples."""
    pictured = {id(v): [p for p in v.contestant.done[0].points if p.image] for v in panel.verdicts}
    seconds, timed = _at_equal_time(results, panel, math.inf)
    at_time = {id(verdict): point for verdict, point in timed}
    spp = _equal_samples(list(pictured.values()))
    at_spp = {key: next((p for p in points if p.spp == spp), None) for key, points in pictured.items()}
    last = {key: points[-1] if points else None for key, points in pictured.items()}
    return {
        "last": _select(results, panel, "last checkpoint", last, NOT_KEPT, True),
        "time": _select(results, panel, f"equal time, {number_text(seconds)} s", at_time, NOT_KEPT, False),
        "samples": _select(results, panel, f"equal samples, {spp} spp", at_spp, f"no image at {spp} spp was kept", True),
    }


def _equal_samples(pictured: list[list[Point]]) -> int:
    """The samples at which most contestants have a picture; of several the most. 0 without pictures."""
    counts = Counter(point.spp for points in pictured for point in points)
    return max(counts, key=lambda spp: (counts[spp], spp), default=0)


def _select(
    results: Results, panel: Panel, words: str, points: Mapping[int, Point | None], without: str, threads_alike: bool
) -> Selection:
    """Up to nine contestants: the best of every engine first, then by final error.

    Threads change no image at equal samples: of contestants that differ in them alone one is enough, where `threads_alike`.
    """
    shown: list[Shown] = []
    missing: list[tuple[str, str]] = []
    seen: dict[Any, str] = {}
    for verdict in ranked(panel):
        name, point = verdict.contestant.name, points.get(id(verdict))
        alike = others(verdict.contestant.settings, "threads")
        image = results.image(point) if point else None
        if threads_alike and alike in seen:
            missing.append((name, f"has the image of {seen[alike]} at equal samples: they differ only in threads"))
        elif point is None:
            missing.append((name, without))
        elif image is None:
            missing.append((name, "its image is missing or damaged"))
        elif len(shown) >= MOST_PICTURES:
            missing.append((name, f"only {MOST_PICTURES} contestants are shown, the best of each engine and then by error"))
        elif shown and image.shape != shown[0].image.shape:
            missing.append((name, "its image has another resolution"))
        else:
            seen[alike] = name
            shown.append(Shown(verdict, point, image))
    same = panel.verdicts[0].contestant.settings
    for contestant in results.contestants:
        s = contestant.settings
        if not contestant.done and (s.scene, s.size, s.division) == (same.scene, same.size, same.division):
            states = ", ".join(dict.fromkeys(cell.state for cell in contestant.cells))
            missing.append((contestant.name, f"has no measured cell ({states or 'not run'})"))
    return Selection(words, shown, missing)


def ranked(panel: Panel) -> list[Verdict]:
    """The best of every engine first, then by final error."""
    ranked = sorted(panel.verdicts, key=lambda v: (math.isnan(v.final_error.value), v.final_error.value))
    engines = list(dict.fromkeys(v.contestant.settings.engine for v in ranked))
    best = [next(v for v in ranked if v.contestant.settings.engine == engine) for engine in engines]
    return [*best, *(v for v in ranked if v not in best)]


def rounded(image: Image) -> NDArray[np.float16]:
    """Half floats with the 8 significant bits that a report shows. NaN and infinity stay; what is too large becomes 65024."""
    with np.errstate(over="ignore", invalid="ignore"):
        finite = np.isfinite(image)
        bits = np.where(finite, np.clip(image, -65024, 65024), image).astype(np.float16).view(np.uint16)
    return np.where(finite, (bits.astype(np.uint32) + 4) & 0xFFF8, bits).astype(np.uint16).view(np.float16)


def point_words(results: Results, point: Point) -> str:
    """`256 spp, 3.21 s, relMSE 4.5e-04`."""
    error, _ = point_error(point, results.metric)
    name = "error" if higher_is_better(results.metric) else metric_title(results.metric).partition(" (")[0]
    return f"{point.spp} spp, {number_text(point.seconds)} s, {name} {number_text(error)}"


def _group(results: Results, panel: Panel, found: Mapping[str, Selection], factor: int) -> PictureGroup:
    """One copy of each picture, however many rules chose it; the reference is the first of every rule."""
    shape = found["last"].shown[0].image.shape
    reference = results.reference(panel.verdicts[0].contestant.done[0].reference_id)
    if reference is not None and reference.mean.shape != shape:
        reference = None
    pictures: list[dict[str, Any]] = []
    if reference is not None:
        data = packed(shrunk(reference.mean, factor))
        pictures.append({"name": "reference", "caption": f"{reference.spp} spp", "data": data})
    places: dict[str, int] = {}
    rules = {}
    for rule, selection in found.items():
        chosen = [0] if reference is not None else []
        for verdict, point, image in selection.shown:
            if image.shape == shape and point.image not in places:
                places[str(point.image)] = len(pictures)
                pictures.append(
                    {
                        "name": verdict.contestant.name,
                        "caption": point_words(results, point),
                        "data": packed(shrunk(image, factor)),
                    }
                )
            if image.shape == shape:
                chosen.append(places[str(point.image)])
        rules[rule] = {"words": selection.words, "pictures": chosen, "missing": selection.missing}
    height, width = shrunk(found["last"].shown[0].image, factor).shape[:2]
    payload = {
        "title": panel.title,
        "width": width,
        "height": height,
        "factor": factor,
        "epsilon": results.epsilon,
        "has_reference": reference is not None,
        "pictures": pictures,
        "rules": rules,
    }
    seconds, crops = _equal_time_crops(results, panel, reference)
    return PictureGroup(panel.title, payload, crops, seconds)


def shrunk(image: Image, factor: int) -> Image:
    """The mean of `factor` x `factor` pixels; a rest at the right and lower edge is cut off."""
    if factor == 1:
        return image
    height, width = (max(size // factor, 1) for size in image.shape[:2])
    cut = image[: height * factor, : width * factor]
    if cut.shape[0] < factor or cut.shape[1] < factor:
        return cut[:1, :1]
    return cut.reshape(height, factor, width, factor, 3).mean(axis=(1, 3))


def packed(image: Image) -> str:
    """Rounded, high bytes before low bytes, deflated, in base64."""
    bits = rounded(image).view(np.uint16)
    planes = np.concatenate([(bits >> 8).ravel(), (bits & 255).ravel()]).astype(np.uint8)
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()


def _at_equal_time(results: Results, panel: Panel, most: float = MOST_CROPS) -> tuple[float, list[tuple[Verdict, Point]]]:
    """(time, the last pictured checkpoint of each contestant's first block within it), by rising error."""
    cells = [(v, [p for p in v.contestant.done[0].points if p.image]) for v in panel.verdicts]
    cells = [(verdict, points) for verdict, points in cells if points]
    if not cells:
        return math.nan, []
    # The time of the contestant that ends first; later where another has no picture by then.
    first_end = min(points[-1].seconds for _, points in cells)
    seconds = max(first_end, *(points[0].seconds for _, points in cells))
    taken = [(verdict, max((p for p in points if p.seconds <= seconds), key=lambda p: p.seconds)) for verdict, points in cells]
    taken.sort(key=lambda pair: point_error(pair[1], results.metric)[0])
    return seconds, taken[: int(min(most, len(taken)))]


def _equal_time_crops(results: Results, panel: Panel, reference: Reference | None) -> tuple[float, list[Crop]]:
    """(time, crops): the last picture of each contestant's first block within the time that all have one for."""
    seconds, taken = _at_equal_time(results, panel)
    found = [(verdict, point, results.image(point)) for verdict, point in taken]
    images = [(verdict, point, image) for verdict, point, image in found if image is not None]
    if not images:
        return math.nan, []
    guide = reference.mean if reference is not None else images[0][2]
    crops = [_crop(guide, guide, "reference", f"{reference.spp} spp")] if reference is not None else []
    crops += [
        _crop(image, guide, verdict.contestant.name, point_words(results, point))
        for verdict, point, image in images
        if image.shape == guide.shape
    ]
    return seconds, crops


def _crop(image: Image, guide: Image, name: str, caption: str) -> Crop:
    y, x = busiest(guide)
    part = to_bitmap(image[y : y + CROP, x : x + CROP])
    address = "data:image/png;base64," + base64.b64encode(png_bytes(part)).decode()
    return Crop(address, name, caption)


def busiest(image: Image) -> tuple[int, int]:
    """(y, x) of the CROP x CROP window of most contrast in display values, on a grid of half windows."""
    grey = to_bitmap(image).mean(axis=2)
    rows, columns = (range(0, max(size - CROP, 0) + 1, CROP // 2) for size in grey.shape)

    def contrast(at: tuple[int, int]) -> float:
        return float(grey[at[0] : at[0] + CROP, at[1] : at[1] + CROP].std())

    return max(((y, x) for y in rows for x in columns), key=contrast)
