"""Of many findings the few that a table shows: of each case and verdict the one nearest to its limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from harness.verify.battery import BROKEN, DECLINED, KEPT, NOT_PROMISED, Finding


class Condensed(NamedTuple):
    """A finding, how many more of its case and verdict it stands for, and the one of them that is worst in ulp."""

    finding: Finding
    rest: int
    spread: Finding


def condensed(found: Sequence[Finding]) -> list[Condensed]:
    """Of the findings of a case, engine, precision and verdict the one nearest to its limit; of broken ones all."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in found:
        group = groups.setdefault((finding.engine, finding.precision, finding.section, finding.case), [])
        group.append(finding)
    rows: list[Condensed] = []
    for group in groups.values():
        for verdict in (KEPT, NOT_PROMISED, DECLINED):
            alike = [finding for finding in group if finding.verdict == verdict]
            if alike:
                rows.append(Condensed(max(alike, key=_closeness), len(alike) - 1, max(alike, key=_worst)))
        rows += [Condensed(finding, 0, finding) for finding in group if finding.verdict == BROKEN]
    return rows


def _worst(finding: Finding) -> float:
    return -1.0 if math.isnan(finding.worst) else finding.worst


def _closeness(finding: Finding) -> float:
    """Error as a share of what is allowed; where nothing is, the error."""
    share = finding.error / finding.allowed if finding.allowed > 0 else finding.error
    return -share if finding.unit == "p" else share
