"""What is concluded from results: a verdict on every contestant, and pairs of engines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from engines.choices import Choice
from harness.analysis.equivalence import EnginePair, percent
from harness.statistics import BiasEstimate, Equivalence, Estimate, PersistentSpread, Slope
from harness.statistics.bias import RadianceSample
from harness.store.records import BROKEN
from harness.store.results import Contestant, Results

if TYPE_CHECKING:
    from harness.analysis.columns import Table

Frame: TypeAlias = Any
"""A DataFrame of pandas, whose columns are attributes that no type checker knows."""
CONTESTANT_KEYS = ["scene", "contestant"]
"""The columns that name a contestant in every DataFrame."""
PER_SAMPLE = "seconds per sample"
"""The measure without a target."""
NOISY = "noisy_reference"
"""Flag of a time to quality, not of all of a contestant's: see `statistics.QualityTime`."""
FLAGS = {
    "biased": "biased",
    "biased_image": "image mean biased",
    "biased_tile": "a tile biased",
    "on_bias_floor": "sits on its bias floor",
    "other_image": "differs from the image baseline",
    "equivalence_unresolved": "not shown to be equivalent to the image baseline",
    "too_good_per_sample": "too good per sample",
    "nonfinite_pixels": "non-finite pixels",
    "bad_samples": "bad samples",
    "ignores_seed": "ignores the seed",
    "stale_image": "returns the image of another seed",
    "reference_copied": "shares the reference's noise",
    "fewer_samples": "errs more than its samples allow",
    "too_many_threads": "uses more threads than allowed",
    "works_between_calls": "works while the clock is stopped",
    "contended": "contended",
    "own_clock": "times reported by the program",
    NOISY: "reference too noisy for the target",
}
"""What a reader of a verdict must know: name -> words."""
OF_THE_TIME = frozenset({"contended", "own_clock", NOISY})
"""Flags that leave a contestant in the rankings. All others say that its image, the error it claims or its conduct is wrong."""
OF_THE_ESTIMATOR = frozenset({"other_image", "equivalence_unresolved", "too_good_per_sample"})
"""Flags that leave a contestant of the open division in its ranking: there another estimator is no offence."""


@dataclass(frozen=True)
class Verdict:
    """All that is concluded about one contestant, but for the times that are compared.

    `image_baseline` is the contestant that the image is compared with. `bias` and `equivalence` are None where images are
    missing or seeds do not differ; `radiance` is what a bias of image mean and tiles was looked for in. `flags` are names of
    `FLAGS`.
    """

    contestant: Contestant
    slope: Slope
    final_error: Estimate
    final_spp: Estimate
    efficiency: Estimate
    samples_per_second: Estimate
    rays_per_second: Estimate
    phases: Mapping[str, Estimate]
    image_baseline: Contestant | None = None
    bias: BiasEstimate | None = None
    radiance: RadianceSample | None = None
    equivalence: Equivalence | None = None
    flags: Sequence[str] = ()

    @property
    def failures(self) -> int:
        """Cells that failed or ran out of time."""
        return sum(cell.state in BROKEN for cell in self.contestant.cells)

    @property
    def disqualified(self) -> bool:
        """Whether a flag keeps it out of all rankings of its division."""
        return bool(self._disqualifying)

    @property
    def why_not_ranked(self) -> str:
        """The flags that keep it out, in words."""
        return ", ".join(self._in_words(self._disqualifying))

    @property
    def _disqualifying(self) -> list[str]:
        allowed = OF_THE_TIME | OF_THE_ESTIMATOR if self.contestant.settings.division == "open" else OF_THE_TIME
        return [flag for flag in self.flags if flag not in allowed]

    @property
    def warnings(self) -> list[str]:
        """The flags in words."""
        return self._in_words(self.flags)

    def _in_words(self, flags: Iterable[str]) -> list[str]:
        """Flags, and by how much an image is biased."""
        size = bias_sizes(self.bias)
        return [FLAGS[flag] + size.get(flag, "") for flag in flags]


def bias_sizes(bias: BiasEstimate | None) -> dict[str, str]:
    """Flag -> by how much, as shares of the radiance."""
    if bias is None:
        return {}
    return {
        "biased": f" by {100 * bias.root:.2g} %",
        "biased_image": f" by {percent(bias.difference)}",
        "biased_tile": f" by {percent(bias.tile_difference)} at pixel {bias.worst_tile}",
    }


@dataclass(frozen=True, eq=False)
class Analysis:
    """`verdicts` of all contestants that have a measured cell. `engine_pairs` are engines compared under equal settings.

    `points` and `cells` are the tables of `measurements`; `crossings`, `times` (to quality), `comparisons` and `by_axis` the
    DataFrames of the functions of these names. `spreads`: (scene, contestant) -> persistent spread of its machine, see
    `comparisons.persistent_spreads`.
    """

    results: Results
    verdicts: Sequence[Verdict]
    points: Table
    cells: Table
    crossings: Frame
    times: Frame
    comparisons: Frame
    by_axis: Frame
    spreads: Mapping[tuple[str, str], PersistentSpread]
    engine_pairs: Sequence[EnginePair]

    def spread(self, contestant: Contestant) -> PersistentSpread:
        """The persistent spread of the machine of a measured contestant."""
        return self.spreads[contestant.settings.scene, contestant.name]

    @cached_property
    def by_target(self) -> Frame:
        """One row a contestant and target: what `comparisons` says with the warm times, and the cold ones as `cold_seconds`."""
        keys, ends = [*CONTESTANT_KEYS, "measure"], ("seconds", "seconds_low", "seconds_high")
        warm, cold = (self.times[self.times.start == start].drop(columns="start") for start in ("warm", "cold"))
        cold = cold[[*keys, *ends]].rename(columns={end: f"cold_{end}" for end in ends})
        return warm.merge(cold, on=keys).merge(self.comparisons, on=keys)

    @cached_property
    def _rows(self) -> Mapping[tuple[str, str, float], Any]:
        return {(row.scene, row.contestant, row.target): row for row in self.by_target.itertuples(index=False)}

    def at(self, contestant: Contestant, target: float) -> Any:
        """The row of `by_target`, a named tuple."""
        return self._rows[contestant.settings.scene, contestant.name, target]

    @cached_property
    def _crossings(self) -> Mapping[Any, Frame]:
        return dict(iter(self.crossings.groupby([*CONTESTANT_KEYS, "measure"], sort=False)))

    def crossings_of(self, contestant: Contestant, target: float) -> Frame:
        """The rows of `crossings` of a contestant's runs, by block, in each reading."""
        return self._crossings[contestant.settings.scene, contestant.name, measure_of(target)]


class Group(NamedTuple):
    """A race: who is compared in times. `shader` is that of the reference."""

    scene: str
    shader: Choice
    size: str
    division: str
    machine: str


def group_of(contestant: Contestant) -> Group:
    """The race that a contestant runs in."""
    s = contestant.settings
    return Group(s.scene, contestant.cells[0].reference_shader, s.size, s.division, s.machine)


def raced_together(verdicts: Iterable[Verdict]) -> dict[Group, list[Verdict]]:
    """The verdicts of each race, those of A/A twins included."""
    groups: dict[Group, list[Verdict]] = {}
    for verdict in verdicts:
        groups.setdefault(group_of(verdict.contestant), []).append(verdict)
    return groups


def ranked_together(verdicts: Iterable[Verdict]) -> dict[Group, list[Verdict]]:
    """The verdicts of each race, without those of the A/A twins' second labels."""
    return raced_together(verdict for verdict in verdicts if not verdict.contestant.settings.label)


def measure_of(target: float | None) -> str:
    """`time to 0.01`; without a target seconds per sample."""
    return PER_SAMPLE if target is None else f"time to {target:.15g}"


def seconds_per_sample(contestant: Contestant) -> dict[int, float]:
    """Block -> warm seconds per sample per pixel, over the whole cell."""
    return {cell.block: cell.end.seconds / cell.end.samples for cell in contestant.done if cell.end.seconds > 0}
