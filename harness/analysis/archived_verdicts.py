"""Verdicts from images, kept as an event: an archive without the images still has them.

Bias, equality with the baseline and pairs of engines need every seed's picture. Nothing else does. What was archived under
the rule of p values is read as unresolved, without bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from harness.analysis.equivalence import Comparison
from harness.analysis.model import Analysis
from harness.statistics import BiasEstimate, Equivalence
from harness.store.results import Results, Settings

EVENT = "archived_verdicts"


@dataclass
class ArchivedVerdicts:
    """By the settings of the contestant, or of both engines of a pair."""

    bias: dict[Settings, BiasEstimate] = field(default_factory=dict)
    baseline: dict[Settings, Equivalence] = field(default_factory=dict)
    pairs: dict[tuple[Settings, Settings], Comparison] = field(default_factory=dict)


def event(analysis: Analysis) -> dict[str, Any]:
    """The verdicts of an analysis that rest on images, as plain data."""
    biased = [(v.contestant.settings, v.bias) for v in analysis.verdicts if v.bias is not None]
    equal = [(v.contestant.settings, v.equivalence) for v in analysis.verdicts if v.equivalence is not None]
    pairs = [(p.first.settings, p.second.settings, p.comparison) for p in analysis.pairs if p.comparison is not None]
    return {
        "event": EVENT,
        "bias": [{"of": list(settings), **found._asdict(), "worst_tile": list(found.worst_tile)} for settings, found in biased],
        "baseline": [{"of": list(settings), **found.as_record()} for settings, found in equal],
        "pairs": [
            {
                "first": list(a),
                "second": list(b),
                "found": c.found.as_record(),
                "replicates": list(c.replicates),
                "spp": list(c.spp),
                "paired": c.paired,
            }
            for a, b, c in pairs
        ],
    }


def read_archived(results: Results) -> ArchivedVerdicts:
    """Those of the results' last such event; none where there is none."""
    rows: Mapping[str, Any] = results.archived_verdicts or {}
    found = ArchivedVerdicts()
    for row in rows.get("bias", []):
        x, y = row.get("worst_tile", (0, 0))
        found.bias[_settings(row["of"])] = BiasEstimate(**{**_without(row, "of"), "worst_tile": (x, y)})
    for row in rows.get("baseline", []):
        found.baseline[_settings(row["of"])] = Equivalence.from_record(_without(row, "of"))
    for row in rows.get("pairs", []):
        pair = _settings(row["first"]), _settings(row["second"])
        replicates, spp = (tuple(row[key]) for key in ("replicates", "spp"))
        found.pairs[pair] = Comparison(Equivalence.from_record(row["found"]), replicates, spp, row["paired"])
    return found


def _settings(values: Sequence[Any]) -> Settings:
    return Settings(*values)


def _without(row: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name != key}
