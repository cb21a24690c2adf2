"""What verdicts rest on, in a sentence: blocks, and the noise floor of every scene."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from harness.analysis import Analysis
from harness.report.tables.model import number_text
from harness.statistics.ratios import FEWEST_BLOCKS


def evidence(analysis: Analysis) -> str:
    """`5 blocks. 2 of 40 timings are contended. Noise floor (A/A twins): cornell_box 1.2 %; ...`; empty without results."""
    return " ".join(filter(None, (blocks_text(analysis), contention_text(analysis), floors_text(analysis))))


def blocks_text(analysis: Analysis) -> str:
    counts = sorted({len({cell.block for cell in verdict.contestant.done}) for verdict in analysis.verdicts})
    if not counts:
        return ""
    text = f"{counts[-1]} block{'' if counts[-1] == 1 else 's'}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} blocks"
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


def floors_text(analysis: Analysis) -> str:
    """The floors over all targets, and what follows where there is none or where twins differ."""
    scenes = list(dict.fromkeys(verdict.contestant.settings.scene for verdict in analysis.verdicts))
    if not scenes:
        return ""
    texts = {scene: floors_of(analysis, scene, [None, *analysis.results.targets]) for scene in scenes}
    known = [f"{scene} {text}" for scene, text in texts.items() if text != NOT_MEASURED]
    without = [scene for scene, text in texts.items() if text == NOT_MEASURED]
    parts = [f"Noise floor (A/A twins): {', '.join(known)}." if known else ""]
    if without:
        where = f" on {', '.join(without)}" if known else ""
        parts.append(f"The noise floor was not measured{where}: nothing is called faster or slower there.")
    apart = sorted({scene for scene, _ in analysis.separated})
    if apart:
        parts.append(f"The A/A twins differ on {', '.join(apart)}: verdicts there are unresolved.")
    return " ".join(filter(None, parts))


NOT_MEASURED = "not measured"


def floor_text(floor: float) -> str:
    """`1.2 %`, a share; `not measured` for NaN."""
    return NOT_MEASURED if math.isnan(floor) else f"{number_text(100 * floor)} %"


def floors_of(analysis: Analysis, scene: str, targets: Iterable[float | None]) -> str:
    """`1.2 %`, `1.2 % to 2.3 %` over several targets (None: seconds per sample), or `not measured`."""
    floors = [math.expm1(analysis.floor(scene, target)) for target in targets]
    known = sorted(floor for floor in floors if not math.isnan(floor))
    return " to ".join(dict.fromkeys(map(floor_text, (known[0], known[-1])))) if known else NOT_MEASURED
