"""What changed significantly between two results folders: for regressions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.analysis import seconds_per_sample
from harness.analysis.columns import Column, Table
from harness.analysis.races import sample_floors
from harness.metrics import metric_title
from harness.statistics import Estimate, unpaired_ratio
from harness.store.results import Contender, Results, Settings, point_error

LEVEL = 0.95
"""Of all intervals together (Sidak)."""


def changes(before: Results, after: Results) -> Table:
    """One row a contender of both folders and measure: seconds per sample, start-up seconds, error.

    Contenders match where scene, engine, settings and size are equal; machine and engine version may differ.
    Intervals are Welch's on logarithms and hold together at 95 %. A time within the A/A noise floor of either folder
    has not changed; where a floor was not measured, it is unresolved. Where the metrics differ, errors are not
    compared; the note says so, and what else to beware of.
    """
    table = Table(
        "changes", "What changed",
        " ".join([f"{before.folder} before, {after.folder} after; ratios are after over before.", *cautions(before, after)]),
        [Column("scene", "Scene."), Column("contender", "Engine and the settings that vary."),
         Column("measure", "seconds per sample (warm), start-up seconds, or error at the most samples that both have."),
         Column("ratio", "After over before; the intervals of all rows hold together at 95 %.", "estimate"),
         Column("verdict", "faster, slower, better, worse, no change, unresolved, or in one folder only.")],
    )  # fmt: skip
    ours, theirs = ({matching(c.settings): c for c in results.contenders if c.done} for results in (before, after))
    common = [key for key in ours if key in theirs]
    level = LEVEL ** (1 / max(3 * len(common), 1))
    floors = [sample_floors(results) for results in (before, after)]
    for key in common:
        floor = float(np.max([found[key.scene] for found in floors]))
        table.rows += _rows(before, after, ours[key], theirs[key], level, floor)
    for only, word in ((set(ours) - set(theirs), "before"), (set(theirs) - set(ours), "after")):
        for key in sorted(only):
            name = (ours if word == "before" else theirs)[key].name
            table.rows.append({"scene": key.scene, "contender": name, "verdict": f"only {word}"})
    return table


def cautions(before: Results, after: Results) -> list[str]:
    """What stands in the way of a comparison: other machines, another metric, scenes with other content."""
    machines, scenes = ([_seen(results, key) for results in (before, after)] for key in ("env_id", "scene_hash"))
    found = []
    if set().union(*machines[0].values()) != set().union(*machines[1].values()):
        found.append("Measured on different machines or with other library versions: times say nothing about the code.")
    if before.metric != after.metric:
        found.append(f"Errors are {metric_title(before.metric)} before and {metric_title(after.metric)} after: not compared.")
    moved = sorted(name for name in scenes[0].keys() & scenes[1].keys() if scenes[0][name] != scenes[1][name])
    if moved:
        found.append(f"Scenes whose content has changed: {', '.join(moved)}.")
    return found


def _seen(results: Results, key: str) -> dict[str, set[str]]:
    """Scene -> the values of a key among its measured cells."""
    found: dict[str, set[str]] = {}
    for cell in results.cells:
        if cell["state"] == "done":
            found.setdefault(str(cell["scene"]), set()).add(str(cell.get(key)))
    return found


def matching(settings: Settings) -> Settings:
    """What has to be equal for two contenders to be the same."""
    return settings._replace(machine="")


def _rows(
    before: Results, after: Results, old: Contender, new: Contender, level: float, floor: float
) -> list[dict[str, Any]]:  # fmt: skip
    spp = max(_checkpoints(old) & _checkpoints(new), default=None) if before.metric == after.metric else None
    measures = [
        ("seconds per sample", list(seconds_per_sample(old).values()), list(seconds_per_sample(new).values()), floor,
         ("faster", "slower")),
        ("start-up seconds", [old.fixed_seconds(c) for c in old.done], [new.fixed_seconds(c) for c in new.done], floor,
         ("faster", "slower")),
        ("error", _errors(before, old, spp), _errors(after, new, spp), 0.0, ("better", "worse")),
    ]  # fmt: skip
    rows = []
    for measure, first, second, least, words in measures:
        ratio = unpaired_ratio(first, second, level)
        rows.append({"scene": old.settings.scene, "contender": old.name, "measure": measure, "ratio": ratio,
                     "verdict": _verdict(ratio, least, words)})  # fmt: skip
    return rows


def _verdict(ratio: Estimate, floor: float, words: tuple[str, str]) -> str:
    """`words` name a ratio below and above 1."""
    if math.isnan(ratio.low) or math.isnan(floor):
        return "unresolved"
    if ratio.high < math.exp(-floor):
        return words[0]
    return words[1] if ratio.low > math.exp(floor) else "no change"


def _checkpoints(contender: Contender) -> set[int]:
    """Samples at which every done cell has a checkpoint."""
    sets: Sequence[set[int]] = [{point["spp"] for point in cell["points"]} for cell in contender.done]
    return set.intersection(*sets)


def _errors(results: Results, contender: Contender, spp: int | None) -> list[float]:
    return [point_error(point, results.metric)[0] for cell in contender.done for point in cell["points"]
            if point["spp"] == spp]  # fmt: skip
