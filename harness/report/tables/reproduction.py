"""What came out again when the measurements of a results folder or an archive were repeated: images, and ratios of times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.errors import ConfigError
from harness.analysis import Analysis
from harness.analysis.axes import matching
from harness.analysis.columns import Column, Table, estimate_of
from harness.analysis.equivalence import bound, same_images
from harness.analysis.measurements import CONTESTANT, SCENE
from harness.report.html.pictures import rounded
from harness.statistics import Estimate, mean_interval
from harness.statistics.tiles import image_scale
from harness.store.records import Cell, Point, Settings
from harness.store.results import Contestant, Results

SAME_DIGITS = 6e-6
"""Relative difference of two means of an image of which one was rounded to six digits."""
STORED_STEP = 2.0**-7
"""Relative difference of two pixels in the precision of archives that may be one step."""
SAME_NUMBERS = 0.95
"""Share of the pixels that must agree up to a step: then both images come from the same random numbers."""
CHANNELS = ("mean_r", "mean_g", "mean_b")


class Images(NamedTuple):
    """`verdict`: identical, equivalent, different, unresolved or not compared; `detail` is what it rests on."""

    verdict: str
    detail: str

    @property
    def reproduced(self) -> bool | None:
        return None if self.verdict == "not compared" else self.verdict in ("identical", "equivalent")


def reproduction(there: Analysis, here: Analysis) -> Table:
    """One row a contestant's image, and one a ratio that is known `there`, where it was measured before.

    A ratio is reproduced where its 95 % intervals overlap. Raises `ConfigError` where `there` has several machines.
    """
    table = Table(
        "reproduction",
        "What was reproduced",
        f"{there.results.folder} there, measured again here. Images are identical where all pixels that both have, in the "
        "precision of archives, and the image means of all checkpoints are. A ratio is reproduced where its intervals overlap.",
        [
            SCENE,
            CONTESTANT,
            Column("what", "image, or the measure of a ratio: seconds per sample or time to a target."),
            Column("there", "The ratio before, baseline over contestant, with its 95 % interval.", "ratio"),
            Column("here", "The same, measured again.", "ratio"),
            Column(
                "verdict", "Images: identical, equivalent, different or unresolved. Ratios: overlap or apart. Or: not compared."
            ),
            Column("detail", "What that rests on."),
            Column("reproduced", "Whether it came out again; unknown where it was not compared.", "flag"),
        ],
    )
    again = _by_settings(here.results)
    ratios = _ratios(here)
    for settings, contestant in _by_settings(there.results).items():
        if not contestant.done or contestant.settings.label:  # which contestants have twins is the planner's choice
            continue
        who = {"scene": settings.scene, "contestant": contestant.name}
        other = again.get(settings)
        if other is None or not other.done:
            table.rows.append({**who, "what": "image", **_not_measured(other)})
            continue
        images = compare_images(there.results, contestant, here.results, other)
        table.rows.append({**who, "what": "image", **images._asdict(), "reproduced": images.reproduced})
        for row in _ratios(there).get((settings.scene, contestant.name), ()):
            table.rows.append({**who, **_ratio_row(row, ratios.get((settings.scene, other.name), ()))})
    return table


def _by_settings(results: Results) -> dict[Settings, Contestant]:
    found: dict[Settings, Contestant] = {}
    for contestant in results.contestants:
        known = found.setdefault(matching(contestant.settings), contestant)
        if known is not contestant:
            if known.done and contestant.done:
                raise ConfigError(f"{results.folder}: has {contestant.name} of several machines: replay each one's folder")
            found[matching(contestant.settings)] = known if known.done else contestant
    return found


def _not_measured(other: Contestant | None) -> dict[str, Any]:
    cells = other.cells if other is not None else ()
    why = "; ".join(dict.fromkeys(f"{cell.state}: {cell.message}" for cell in cells)) or "not part of the experiment here"
    return {"verdict": "not compared", "detail": why, "reproduced": False}


def compare_images(before: Results, one: Contestant, after: Results, other: Contestant) -> Images:
    """The images of a contestant in two folders: of the same seeds, at the checkpoints that both have."""
    pairs = [(a, b) for a in one.done for b in other.done if a.seed == b.seed]
    if pairs and any(a.scene_hash != b.scene_hash for a, b in pairs):
        return Images("different", "the scene has another content here")
    points = [(a, b) for cell, again in pairs for a, b in _both(cell, again)]
    if not points:
        return Images("not compared", "no seed has a checkpoint at the same samples")
    alike = [_same_means(a, b) for a, b in points]
    pictures = [(a, b) for a, b in _pictures(before, after, points) if a.shape == b.shape]
    same = [float((a == b).all(axis=2).mean()) for a, b in pictures]
    means = f"means of {sum(alike)} of {len(points)} checkpoints of {len(pairs)} seeds are equal"
    detail = f"{means}; {_pixels(same)}"
    if all(alike) and all(share == 1.0 for share in same):
        return Images("identical", detail)
    found = same_images(before, one, after, other, 1)
    if found is not None:
        return Images(found.verdict, f"{detail}; image means differ by at most {bound(found.image_bound)}")
    if pictures and min(_near(a, b) for a, b in pictures) >= SAME_NUMBERS:
        return Images("equivalent", f"{detail}; the rest differ by rounding")
    verdict, most = _by_means(points, len(pairs), after.config.equivalence.margins.image)
    return Images(verdict, f"{detail}; image means differ by at most {bound(most)}")


def _both(one: Cell, other: Cell) -> Iterator[tuple[Point, Point]]:
    again = {point.spp: point for point in other.points}
    return ((point, again[point.spp]) for point in one.points if point.spp in again)


def _same_means(one: Point, other: Point) -> bool:
    return np.allclose(_means(one), _means(other), rtol=SAME_DIGITS, atol=0.0)


def _means(point: Point) -> NDArray[np.float64]:
    """(3,): the means of the image's channels; NaN where they are not known."""
    values = [point.metrics.get(name) for name in CHANNELS]
    return np.array([math.nan if value is None else value for value in values])


def _pictures(before: Results, after: Results, points: list[tuple[Point, Point]]) -> Iterator[tuple[Any, Any]]:
    """Pairs of kept images in the precision of archives."""
    for a, b in points:
        first, second = (before.image(a), after.image(b)) if a.image and b.image else (None, None)
        if first is not None and second is not None:
            yield rounded(first).astype(np.float64), rounded(second).astype(np.float64)


def _pixels(same: list[float]) -> str:
    if not same:
        return "no images are kept on both sides"
    return f"{len(same)} image{'s' if len(same) > 1 else ''}: {math.floor(1e4 * min(same)) / 100:g} % of the pixels are equal"


def _near(one: Any, other: Any) -> float:
    """The share of pixels that differ by a step of the stored precision at most."""
    limit = STORED_STEP * np.maximum(abs(one), abs(other))
    return float((abs(one - other) <= limit).all(axis=2).mean())


def _by_means(points: list[tuple[Point, Point]], seeds: int, margin: float) -> tuple[str, float]:
    """(verdict, bound) from the image means at the most samples that all seeds have: equivalent where their differences,
    as shares, are within the margin by Student's 95 % interval over seeds."""
    counts: dict[int, list[tuple[Point, Point]]] = {}
    for pair in points:
        counts.setdefault(pair[0].spp, []).append(pair)
    common = [spp for spp, found in counts.items() if len(found) == seeds]
    if not common:
        return "unresolved", math.nan
    before, after = (np.array([_means(pair[side]) for pair in counts[max(common)]]) for side in (0, 1))
    scale = image_scale((before + after).mean(axis=0)[None, None] / 2)
    ends = [mean_interval(channel) for channel in ((after - before) / np.where(scale > 0, scale, 1.0)).T]
    most = max(max(abs(found.low), abs(found.high)) for found in ends)
    least = max(max(found.low, -found.high) for found in ends)
    return ("equivalent" if most <= margin else "different" if least > margin else "unresolved"), most


def _ratios(analysis: Analysis) -> dict[tuple[str, str], list[Any]]:
    """(scene, contestant) -> its rows of `comparisons` that are compared with a baseline, with the settings of that."""
    found: dict[tuple[str, str], list[Any]] = {}
    settings = {(one.settings.scene, one.name): matching(one.settings) for one in analysis.results.contestants}
    rows = analysis.comparisons[analysis.comparisons.baseline != ""]
    against = [settings[key] for key in zip(rows.scene, rows.baseline, strict=True)]
    for row in rows.assign(against=against).itertuples(index=False):
        found.setdefault((row.scene, row.contestant), []).append(row)
    return found


def _ratio_row(row: Any, again: Any) -> dict[str, Any]:
    """How a ratio came out again, of the rows of the same contestant."""
    before = estimate_of(row, "ratio")
    found: Mapping[str, Any] = {"what": row.measure, "there": before}
    if row.no_ratio or not _known(before):
        return {**found, "verdict": "not compared", "detail": row.no_ratio or "it has no interval there"}
    same = next((each for each in again if each.measure == row.measure), None)
    if same is None:
        return {**found, "verdict": "not compared", "detail": "this measure is not there here", "reproduced": False}
    after = estimate_of(same, "ratio")
    found = {**found, "here": after}
    if same.against != row.against:
        words = f"compared with {row.baseline} there, with {same.baseline} here"
        return {**found, "verdict": "not compared", "detail": words}
    if same.no_ratio or not _known(after):
        return {**found, "verdict": "not compared", "detail": same.no_ratio or "it has no interval here", "reproduced": False}
    overlap = before.low <= after.high and after.low <= before.high
    return {**found, "verdict": "overlap" if overlap else "apart", "detail": f"against {row.baseline}", "reproduced": overlap}


def _known(found: Estimate) -> bool:
    """Whether an interval says anything."""
    return not math.isnan(found.value) and (found.low > 0 or found.high < math.inf)


def differences_of_machines(there: Results, here: Results) -> list[str]:
    """`numba: 0.67 there, 0.68 here`, of what manifests say of processor, system and libraries."""
    sides = [_machine(results) for results in (there, here)]
    keys = dict.fromkeys([*sides[0], *sides[1]])
    return [
        f"{key}: {sides[0].get(key, 'none')} there, {sides[1].get(key, 'none')} here"
        for key in keys
        if sides[0].get(key) != sides[1].get(key)
    ]


def _machine(results: Results) -> dict[str, Any]:
    machine = results.manifest.machine
    known = ("cpu", "usable_cores", "system", "kernel", "architecture", "python", "raybench")
    commit = {"commit": (machine.get("git") or {}).get("commit")}
    found = {**{key: machine.get(key) for key in known}, **commit, **machine.get("libraries", {})}
    return {key: value for key, value in found.items() if value is not None}
