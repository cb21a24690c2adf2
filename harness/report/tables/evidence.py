"""What verdicts rest on, in a sentence: blocks, contention, and the persistent spread of every machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from harness.analysis import Analysis
from harness.analysis.calibration import plural
from harness.config.experiment import FEWEST_TWINS
from harness.statistics.ratios import FEWEST_BLOCKS, PersistentSpread


def evidence(analysis: Analysis) -> str:
    """`5 blocks. 2 of 40 timings are contended. Persistent spread: 3 % (4 twins).`; empty without results."""
    return " ".join(filter(None, (blocks_text(analysis), contention_text(analysis), spread_text(analysis))))


def blocks_text(analysis: Analysis) -> str:
    counts = sorted({len({cell.block for cell in verdict.contestant.done}) for verdict in analysis.verdicts})
    if not counts:
        return ""
    text = plural(counts[-1], "block") if len(counts) == 1 else f"{counts[0]} to {counts[-1]} blocks"
    if counts[0] < FEWEST_BLOCKS:
        text += f"; below {FEWEST_BLOCKS} no verdict is given"
    return f"{text}."


def contention_text(analysis: Analysis) -> str:
    """How many of the cells that count were contended, and of how many that is known."""
    return contended_text([cell.machine.contended for verdict in analysis.verdicts for cell in verdict.contestant.done])


def contended_text(contended: Sequence[bool | None]) -> str:
    """How many timings were contended, and of how many that is known (not None); empty without timings."""
    judged = [each for each in contended if each is not None]
    if not judged:
        return "Contention was not measured." if contended else ""
    if not any(judged):
        return "No timing is contended."
    return f"{sum(judged)} of {len(judged)} timings {'is' if sum(judged) == 1 else 'are'} contended."


def spread_text(analysis: Analysis) -> str:
    """`spreads_text` of the machines on which something was rendered."""
    found = (verdict.contestant for verdict in analysis.verdicts)
    return spreads_text({one.settings.machine: analysis.spread(one) for one in found})


def spreads_text(machines: Mapping[str, PersistentSpread]) -> str:
    """The persistent spread of each machine, and what follows where it is not known, or hardly."""
    return " ".join(
        f"Persistent spread{f' on {machine}' if len(machines) > 1 else ''}: {spread_of(spread)}"
        f"{f'; {weakness}' if (weakness := weakness_of(spread)) else ''}."
        for machine, spread in machines.items()
    )


NOT_MEASURED = "not measured"
WITHOUT_TWINS = "without A/A twins nothing is called faster, slower or the same"


def spread_of(spread: PersistentSpread) -> str:
    """`3 % (4 twins)`, or `not measured`."""
    return f"{share_text(spread.share)} ({plural(spread.twins, 'twin')})" if spread.twins else NOT_MEASURED


def weakness_of(spread: PersistentSpread) -> str:
    """What a spread of few twins means for verdicts; empty for one that is known well enough."""
    if not spread.twins:
        return WITHOUT_TWINS
    return f"fewer than {FEWEST_TWINS} twins tell little of it" if spread.twins < FEWEST_TWINS else ""


def share_text(share: float) -> str:
    """`1.2 %`, a share; `not measured` for NaN."""
    return NOT_MEASURED if math.isnan(share) else f"{100 * share:.2g} %"
