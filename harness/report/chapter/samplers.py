"""Whose error is smaller, at the same number of samples and in the same time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.analysis import Analysis, error_targets
from harness.report.chapter import figures
from harness.report.chapter.document import Paragraph, Section, TablePart
from harness.report.chapter.families import (
    Family,
    Measure,
    best,
    estimate,
    families,
    identity,
    pairs,
    row_of,
    value_columns,
)
from harness.report.chapter.sentences import ERROR, QUALITY, SPEED, error_name, listed, tally
from harness.report.tables import Column, Table
from harness.store.results import Contestant, point_error


def section(analysis: Analysis, plots: Path) -> Section | None:
    """Whose error is smaller, at the same number of samples and in the same time."""
    found = families(analysis, "sampler")
    if not found:
        return None
    parts: list[Any] = [Paragraph([
        "At the same number of samples:", *(tally(pair, ERROR) for pair in _error_pairs(analysis, found)),
    ])]  # fmt: skip
    parts += [TablePart(_error_table(analysis, found)), *figures.part(figures.sampler_errors(analysis, found, plots))]
    timed = _quality_table(analysis, found)
    if timed.rows:
        parts += [
            Paragraph(["By the time to a quality, the hardest target that all of them reach with every seed:",
                       *_quality_tallies(analysis, found)]),
            TablePart(timed),
        ]  # fmt: skip
    costs = [tally(pair, SPEED) for pair in pairs(analysis, found)]
    parts.append(Paragraph(["By the cost of a sample:", *costs]))
    return Section("Samplers", parts)


def _common_spp(family: Family) -> int | None:
    """The most samples at which every seed of every member has a checkpoint."""
    sets = [{point["spp"] for point in cell["points"]} for c in family.members.values() for cell in c.done]
    return max(set.intersection(*sets), default=None)


def _errors_at(analysis: Analysis, spp: int | None) -> Measure:
    """Error at `spp` samples, where it is above three of its standard errors. It repeats, so that its noise floor is 0."""

    def values(contestant: Contestant) -> Mapping[int, float]:
        found = {}
        for cell in contestant.done:
            for point in cell["points"]:
                error, spread = point_error(point, analysis.results.metric)
                if point["spp"] == spp and error > 3 * spread:
                    found[cell["block"]] = error
        return found

    return Measure(values, 0.0)


def _error_pairs(analysis: Analysis, found: list[Family]) -> list[Any]:
    return pairs(analysis, found, lambda family: _errors_at(analysis, _common_spp(family)))


def _error_table(analysis: Analysis, found: list[Family]) -> Table:
    table = Table(
        "samplers", "Error at the same number of samples",
        f"{error_name(analysis.results.metric)}; geometric mean over seeds with a 95 % interval. Errors that the reference's "
        "noise hides are left out. Least: all that may have it.",
        [*identity(found), Column("spp", "Samples per pixel.", "count"),
         *value_columns(found, "Error of {}."), Column("least", "The least error.")],
    )  # fmt: skip
    for family in found:
        spp = _common_spp(family)
        measure = _errors_at(analysis, spp)
        least = listed(best(analysis, family, measure))
        table.rows.append(row_of(family, lambda c, measure=measure: estimate(measure.values(c)), spp=spp, least=least))
    return table


def _times_to(analysis: Analysis, family: Family, index: int) -> Measure:
    """Warm seconds until the target of `index`, which all of a family reach."""

    def values(contestant: Contestant) -> Mapping[int, float]:
        verdict = next(verdict for verdict in analysis.verdicts if verdict.contestant is contestant)
        return {cell["block"]: bound.high for cell, bound in zip(contestant.runs, verdict.warm[index].crossings, strict=True)}

    return Measure(values, analysis.floor(family.scene, index))


def _hardest(analysis: Analysis, family: Family) -> int | None:
    """Index of the hardest target that every member reaches with every seed, none at its first checkpoint already."""
    verdicts = [v for v in analysis.verdicts if any(v.contestant is member for member in family.members.values())]
    for index in reversed(range(len(analysis.results.targets))):
        found = [verdict.warm[index] for verdict in verdicts]
        if all(quality.reached == quality.seeds for quality in found):
            return index if not any(quality.at_first for quality in found) else None
    return None


def _quality_tallies(analysis: Analysis, found: list[Family]) -> list[str]:
    timed = {id(family): _hardest(analysis, family) for family in found}
    kept = [family for family in found if timed[id(family)] is not None]
    return [tally(pair, QUALITY) for pair in pairs(analysis, kept, lambda f: _times_to(analysis, f, timed[id(f)] or 0))]


def _quality_table(analysis: Analysis, found: list[Family]) -> Table:
    table = Table(
        "sampler_times", "Time to a quality by sampler",
        f"Seconds of rendering until the hardest target that all reach, in {error_name(analysis.results.metric)}; geometric "
        "mean over seeds with a 95 % interval.",
        [*identity(found), Column("target", "Quality to reach.", "exact"),
         *value_columns(found, "Seconds of {}.", "{} [s]")],
    )  # fmt: skip
    for family in found:
        index = _hardest(analysis, family)
        if index is not None:
            values = _times_to(analysis, family, index).values
            target = error_targets(analysis.results)[index]
            table.rows.append(row_of(family, lambda c, values=values: estimate(values(c)), target=target))
    return table
