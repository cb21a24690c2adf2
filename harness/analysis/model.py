"""What is concluded from results: a verdict on every contender, and pairs of engines."""

from __future__ import annotations

from dataclasses import dataclass, field

from harness.analysis.equivalence import EnginePair
from harness.statistics import BiasEstimate, Equivalence, Estimate, QualityTime, Slope, Speedup
from harness.store.results import Contender, Results


@dataclass
class Verdict:
    """All that is concluded about one contender. Lists run along the results' targets.

    `speedup` compares seconds per sample with `baseline`, `quality_speedups` warm time-to-quality. `bias` and
    `equivalence` are None where images are missing or seeds do not differ. `flags` are short warnings in plain words.
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


def seconds_per_sample(contender: Contender) -> dict[int, float]:
    """Block -> warm seconds per sample per pixel, over the whole cell."""
    ends = {cell["block"]: cell["points"][-1] for cell in contender.done}
    return {block: end["seconds"] / end["spp"] for block, end in ends.items() if end["seconds"] > 0 and end["spp"] > 0}
