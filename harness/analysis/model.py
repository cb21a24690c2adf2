"""What is concluded from results: a verdict on every contender, and pairs of engines."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from harness.analysis.equivalence import EnginePair
from harness.statistics import BiasEstimate, Equivalence, Estimate, QualityTime, Slope, Speedup
from harness.store.results import Contender, Results

FLAGS = {
    "biased": "biased",
    "biased_image": "image mean biased",
    "biased_tile": "a tile biased",
    "on_bias_floor": "sits on its bias floor",
    "other_image": "differs from the baseline's image",
    "too_good_per_sample": "too good per sample",
    "nonfinite_pixels": "non-finite pixels",
    "bad_samples": "bad samples",
    "contended": "contended",
    "own_clock": "times reported by the program",
}
"""What a reader of a verdict must know: name -> words."""


@dataclass
class Verdict:
    """All that is concluded about one contender. Lists run along the results' targets.

    `speedup` compares seconds per sample with `baseline`, `quality_speedups` warm time-to-quality. `bias` and
    `equivalence` are None where images are missing or seeds do not differ. `flags` are names of `FLAGS`.
    """

    contender: Contender
    warm: list[QualityTime]
    cold: list[QualityTime]
    slope: Slope
    final_error: Estimate
    final_spp: Estimate
    efficiency: Estimate
    samples_per_second: Estimate
    rays_per_second: Estimate
    phases: dict[str, Estimate]
    baseline: Contender | None = None
    speedup: Speedup | None = None
    quality_speedups: list[Speedup] = field(default_factory=list)
    bias: BiasEstimate | None = None
    equivalence: Equivalence | None = None
    flags: list[str] = field(default_factory=list)

    @property
    def failures(self) -> int:
        """Cells that failed or ran out of time."""
        return sum(cell["state"] in ("failed", "timeout") for cell in self.contender.cells)

    @property
    def warnings(self) -> list[str]:
        """The flags in words."""
        size = bias_sizes(self.bias)
        return [FLAGS[flag] + size.get(flag, "") for flag in self.flags]


def bias_sizes(bias: BiasEstimate | None) -> dict[str, str]:
    """Flag -> by how much, as shares of the radiance."""
    if bias is None:
        return {}
    return {
        "biased": f" by {100 * bias.root:.2g} %", "biased_image": f" by {100 * bias.difference:+.2g} %",
        "biased_tile": f" by {100 * bias.tile_difference:+.2g} % at pixel {bias.worst_tile}",
    }  # fmt: skip


@dataclass
class Analysis:
    """`verdicts` of all contenders that have a measured cell; `floors`: scene -> noise floor (log-ratio) of its A/A.

    `pairs` are engines compared under equal settings.
    """

    results: Results
    verdicts: list[Verdict]
    floors: dict[str, float]
    baseline_engine: str
    pairs: list[EnginePair] = field(default_factory=list)

    def of_scene(self, scene: str) -> list[Verdict]:
        return [verdict for verdict in self.verdicts if verdict.contender.settings.scene == scene]


def ranked_together(verdicts: Iterable[Verdict]) -> dict[tuple[str, str, str, str], list[Verdict]]:
    """(scene, shader, size, machine) -> its verdicts; those of the A/A twin's second label are left out."""
    groups: dict[tuple[str, str, str, str], list[Verdict]] = {}
    for verdict in verdicts:
        s = verdict.contender.settings
        if not s.label:
            groups.setdefault((s.scene, s.shader, s.size, s.machine), []).append(verdict)
    return groups


def possible_winners(verdicts: Iterable[Verdict], index: int, floor: float) -> list[Verdict]:
    """The first to reach the target of `index` (warm), and after it all that are not surely slower.

    Surely slower is whose interval lies above that of the first, widened by the noise floor (a log-ratio). Without an
    interval nothing is sure.
    """
    arrived = [verdict for verdict in verdicts if math.isfinite(verdict.warm[index].median)]
    ranked = sorted(arrived, key=lambda verdict: verdict.warm[index].median)
    return [v for v in ranked if v is ranked[0] or not v.warm[index].low > ranked[0].warm[index].high * math.exp(floor)]


def seconds_per_sample(contender: Contender) -> dict[int, float]:
    """Block -> warm seconds per sample per pixel, over the whole cell."""
    ends = {cell["block"]: cell["points"][-1] for cell in contender.done}
    return {block: end["seconds"] / end["spp"] for block, end in ends.items() if end["seconds"] > 0 and end["spp"] > 0}
