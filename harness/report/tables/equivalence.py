"""Tables on images: bias against the reference, equivalence with the image baseline and of engines, results of the suite."""

from __future__ import annotations

import math
from typing import Any

from harness.analysis import Analysis, Verdict
from harness.analysis.columns import Column, Table
from harness.analysis.equivalence import bound, rests_on
from harness.analysis.measurements import CONTESTANT, SCENE
from harness.analysis.model import bias_sizes
from harness.check_results import worst_per_check
from harness.statistics import Equivalence, Estimate

IMAGE_BASELINE = Column(
    "image_baseline", "Contestant whose image it is compared with: the most similar one of the baseline engine."
)
BOUNDS = [
    Column(
        "difference",
        "Relative difference of the image means: second over first (or contestant over image baseline) minus 1; 95 % interval.",
        "estimate",
    ),
    Column("image_bound", "Upper bound on the difference of the image means, in any channel.", "percent", "means at most"),
    Column(
        "tile_bound", "Upper bound on the difference of any tile of 16x16 pixels, in any channel.", "percent", "tiles at most"
    ),
    Column("worst_tile", "First pixel (x, y) of that tile.", title="worst tile"),
    Column("same_pixels", "Pixels that agree up to rounding, in the pair with the fewest.", "percent", "same pixels"),
]
VERDICTS = (
    "identical (up to rounding: the same random numbers, or none), equivalent (both bounds within the margins), "
    "different (surely outside one of them), unresolved"
)


def bias_and_equivalence(analysis: Analysis) -> Table:
    """Bias against the reference, equivalence with the image baseline."""
    table = Table(
        "bias_and_equivalence",
        "Bias against the reference, equivalence with the image baseline",
        f"Shares of the radiance; for a tile, of its radiance, at least 0.1 of the image's mean. {_margins(analysis)}",
        [
            SCENE,
            CONTESTANT,
            IMAGE_BASELINE,
            Column("bias_squared", "mean((A-R1)(B-R2)/(R^2+eps)) over pairs of seeds.", "number"),
            Column("bias_squared_se", "Its standard error.", "number"),
            Column(
                "bias_difference",
                "Relative difference of the means of image and reference, in the channel where it is "
                "largest; flagged at 3 standard errors.",
                "percent",
                "bias of the mean",
            ),
            Column("bias_image_z", "That difference in standard errors.", "number"),
            Column(
                "bias_tile_difference",
                "The same of the 16x16 tile that is off by most standard errors; flagged at 4.5.",
                "percent",
                "bias of a tile",
            ),
            Column("bias_tile_z", "That difference in standard errors.", "number"),
            Column("bias", "Bias against the reference, or the most that the image mean and any tile can be off."),
            *BOUNDS,
            Column("verdict", f"Against the image baseline: {VERDICTS}."),
        ],
    )
    for verdict in analysis.verdicts:
        table.rows.append(_bias_row(verdict))
    return table


def _bias_row(verdict: Verdict) -> dict[str, Any]:
    row: dict[str, Any] = {
        **who(verdict),
        "image_baseline": verdict.image_baseline.name if verdict.image_baseline else None,
        "bias": bias_text(verdict),
        "verdict": equivalence_text(verdict),
    }
    bias = verdict.bias
    if bias is not None:
        row |= {
            "bias_squared": bias.squared,
            "bias_squared_se": bias.se,
            "bias_image_z": bias.image_z,
            "bias_difference": bias.difference,
            "bias_tile_z": bias.tile_z,
            "bias_tile_difference": bias.tile_difference,
        }
    return row | (_bounds(verdict.equivalence, 0) if verdict.equivalence is not None else {})


def equivalence(analysis: Analysis) -> Table:
    """Every pair of engines on the same scene under the same settings."""
    table = Table(
        "equivalence",
        "Pairs of engines",
        "The most similar contestants of two engines with the same scene, shader, size and sampler, in pairs of one block. "
        f"{_margins(analysis)}",
        [
            SCENE,
            Column("first", "One engine."),
            Column("second", "The other."),
            Column("verdict", f"{VERDICTS}, or unknown where there are no images of two seeds."),
            *BOUNDS,
            Column("rests_on", "Pairs of images, and their samples per pixel."),
        ],
    )
    for pair in analysis.engine_pairs:
        row: dict[str, Any] = {
            "scene": pair.first.settings.scene,
            "first": pair.first.name,
            "second": pair.second.name,
            "verdict": pair.verdict,
        }
        if pair.comparison is not None:
            row |= _bounds(pair.comparison.found, pair.comparison.replicates[0])
            row |= {"verdict": pair.comparison.found.verdict, "rests_on": rests_on(pair.comparison)}
        table.rows.append(row)
    return table


def _margins(analysis: Analysis) -> str:
    image, tile = analysis.results.config.equivalence.margins
    return (
        f"Equivalent: the image means differ by at most {100 * image:g} % and no tile of 16x16 pixels by more than "
        f"{100 * tile:g} %."
    )


def _bounds(found: Equivalence, images: int) -> dict[str, Any]:
    values = {name: getattr(found, name) for name in ("image_bound", "tile_bound", "same_pixels")}
    x, y = found.worst_tile
    return {**values, "difference": Estimate(found.difference, found.low, found.high, images), "worst_tile": f"{x}, {y}"}


def accuracy(analysis: Analysis) -> Table:
    """Results of the accuracy suite, where the config has `verify`: the worst of each check, and every failure."""
    table = Table(
        "accuracy",
        "Accuracy",
        "Cases of `raybench verify` that the config names. All passes of a case share one row, which has the result nearest "
        "to its tolerance and the number of results. Every failure has a separate row.",
        [
            Column("case", "Id of the case."),
            Column("description", "What the case checks."),
            Column("engine", "Engine."),
            Column("precision", "The setting."),
            Column("parameter", "What was varied."),
            Column("error", "The largest error.", "number"),
            Column("unit", "Unit of error and tolerance."),
            Column("tolerance", "The largest error that passes, by the precision in which the engine traces.", "number"),
            Column("outcome", "pass, fail, xfail (no tolerance in this precision) or skip."),
            Column("stands_for", "Number of results that the row summarises.", "count"),
        ],
    )
    for result, others, _ in worst_per_check(analysis.results.check_results):
        row = {column.name: getattr(result, column.name) for column in table.columns[:-1]}
        table.rows.append(row | {"stands_for": others + 1})
    return table


def bias_text(verdict: Verdict) -> str:
    """`mean < 0.08 %, tiles < 1.9 %`: the most that a bias can be, in radiance; `+2.9 %, flagged`; or `unknown`."""
    bias = verdict.bias
    if bias is None or math.isnan(bias.squared):
        return "unknown"
    if bias.flags:
        return f"{'; '.join(_size(verdict, flag) for flag in bias.flags)}, flagged"
    return f"mean < {bound(bias.image_bound)}, tiles < {bound(bias.tile_bound)}"


def _size(verdict: Verdict, flag: str) -> str:
    names = {"biased": "pixels", "biased_image": "mean", "biased_tile": "tile"}
    return names[flag] + bias_sizes(verdict.bias)[flag].replace(" by ", " ")


def equivalence_text(verdict: Verdict) -> str:
    if verdict.image_baseline is None:
        return "image baseline"
    return verdict.equivalence.verdict if verdict.equivalence is not None else "unknown"


def who(verdict: Verdict) -> dict[str, Any]:
    """The first cells of a row."""
    return {"scene": verdict.contestant.settings.scene, "contestant": verdict.contestant.name}
