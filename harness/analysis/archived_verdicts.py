"""Verdicts from images, kept as an event: an archive without the images still has them.

Bias, equality with the baseline and pairs of engines need every seed's picture. Nothing else does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from harness.analysis.equivalence import Comparison
from harness.analysis.model import Analysis
from harness.statistics import BiasEstimate, Equivalence
from harness.store.records import ArchivedBias, ArchivedEquivalence, ArchivedPair, ArchivedVerdicts, Settings
from harness.store.results import Results


@dataclass(frozen=True)
class FromImages:
    """By the settings of the contestant, or of both engines of a pair."""

    bias: dict[Settings, BiasEstimate] = field(default_factory=dict)
    baseline: dict[Settings, Equivalence] = field(default_factory=dict)
    pairs: dict[tuple[Settings, Settings], Comparison] = field(default_factory=dict)


def archived(analysis: Analysis) -> ArchivedVerdicts:
    """The verdicts of an analysis that rest on images."""
    verdicts = analysis.verdicts
    return ArchivedVerdicts(
        bias=tuple(ArchivedBias(of=v.contestant.settings, found=v.bias) for v in verdicts if v.bias is not None),
        baseline=tuple(
            ArchivedEquivalence(of=v.contestant.settings, found=v.equivalence) for v in verdicts if v.equivalence is not None
        ),
        pairs=tuple(
            ArchivedPair(first=pair.first.settings, second=pair.second.settings, **pair.comparison._asdict())
            for pair in analysis.engine_pairs
            if pair.comparison is not None
        ),
    )


def read_archived(results: Results) -> FromImages:
    """Those of the results' last such event; none where there is none."""
    kept = results.archived_verdicts
    if kept is None:
        return FromImages()
    return FromImages(
        {row.of: row.found for row in kept.bias},
        {row.of: row.found for row in kept.baseline},
        {(row.first, row.second): Comparison(row.found, row.replicates, row.spp, row.paired) for row in kept.pairs},
    )
