"""Tables on images: bias against the reference, equivalence with the baseline and of engines, results of the suite."""

from __future__ import annotations

import math
from typing import Any

from harness.analysis import Analysis, Verdict
from harness.analysis.columns import Column, Table
from harness.statistics import Estimate
from harness.statistics.equivalence import ALPHA

SCENE = Column("scene", "Scene that was rendered.")
CONTENDER = Column("contender", "Engine and those settings that differ within this experiment.")
TESTS = ("detectable", "image_p", "tile_p", "tile_threshold", "pixel_p", "pixel_threshold", "pixels_outside", "ks_p")
BASELINE = Column("baseline", "Contender compared with: the baseline engine's nearest relative.")


def bias_and_equivalence(analysis: Analysis) -> Table:
    """Bias against the reference, equivalence with the baseline."""
    table = Table(
        "bias_and_equivalence", "Bias against the reference, equivalence with the baseline",
        "Equivalence at three scales: p values of Welch tests against their Sidak thresholds (1 % a scale, all rows together), "
        "and a margin test of 1 % on the image mean.",
        [SCENE, CONTENDER, BASELINE,
         Column("bias_squared", "mean((A-R1)(B-R2)/(R^2+eps)) over pairs of seeds.", "number"),
         Column("bias_squared_se", "Its standard error.", "number"),
         Column("bias", "Relative bias against the reference; flagged above 3 standard errors."),
         Column("difference", "Relative difference of the image means, 90 % interval.", "estimate"),
         Column("detectable", "Relative bias of the mean seen with 80 % power.", "percent"),
         Column("image_p", "Welch p of the image means.", "number"),
         Column("tile_p", "Smallest Welch p of the 8x8 tiles.", "number"),
         Column("tile_threshold", "Sidak threshold of a tile.", "number"),
         Column("pixel_p", "Smallest Welch p of the pixels and channels.", "number"),
         Column("pixel_threshold", "Sidak threshold of a pixel.", "number"),
         Column("pixels_outside", "Pixels and channels below the threshold.", "count"),
         Column("ks_p", "Kolmogorov-Smirnov p of the tiles' p values.", "number"),
         Column("verdict", "equivalent, different or inconclusive.")],
    )  # fmt: skip
    for verdict in analysis.verdicts:
        table.rows.append(_equivalence_row(verdict))
    return table


def _equivalence_row(verdict: Verdict) -> dict[str, Any]:
    row: dict[str, Any] = {**who(verdict), "baseline": verdict.baseline.name if verdict.baseline else None,
                           "bias": bias_text(verdict), "verdict": equivalence_text(verdict)}  # fmt: skip
    if verdict.bias is not None:
        row |= {"bias_squared": verdict.bias.squared, "bias_squared_se": verdict.bias.se}
    found = verdict.equivalence
    if found is not None:
        row |= {name: getattr(found, name) for name in TESTS}
        row["difference"] = Estimate(found.difference, found.low, found.high, 0)
    return row


def equivalence(analysis: Analysis) -> Table:
    """Every pair of engines on the same scene under the same settings."""
    table = Table(
        "equivalence", "Pairs of engines",
        "Nearest relatives on the same scene, shader, size and sampler. Welch tests at three scales and "
        "Kolmogorov-Smirnov on the tiles' p values, corrected for the number of tests and pairs (Sidak): different "
        "below 0.01. Margin test (TOST): equal are images "
        "whose means surely differ by less than 1 %.",
        [SCENE, Column("first", "One engine."), Column("second", "The other."),
         Column("verdict", "equivalent, different, inconclusive, or unknown where there are no images of two seeds."),
         Column("difference", "Second over first, less one, of the image means; 90 % interval (TOST).", "estimate"),
         Column("detectable", "Relative bias of the mean seen with 80 % power.", "percent"),
         Column("rests_on", "Images of each, one a seed, their samples per pixel, and whether seeds make pairs."),
         Column("image_p", "p of the image means.", "number"),
         Column("tile_p", "Smallest Welch p of the 8x8 tiles.", "number"),
         Column("pixel_p", "Smallest Welch p of the pixels and channels.", "number"),
         Column("pixels_outside", "Pixels and channels that differ.", "count", "outside"),
         Column("ks_p", "Kolmogorov-Smirnov p of the tiles' p values.", "number")],
    )  # fmt: skip
    for pair in analysis.pairs:
        row: dict[str, Any] = {"scene": pair.first.settings.scene, "first": pair.first.name,
                               "second": pair.second.name, "verdict": pair.verdict}  # fmt: skip
        if pair.comparison is not None:
            found, images, spp, paired = pair.comparison
            limits = {"image_p": found.alpha, "tile_p": found.tile_threshold, "pixel_p": found.pixel_threshold,
                      "ks_p": found.alpha}  # fmt: skip
            row |= {name: corrected(getattr(found, name), limit) for name, limit in limits.items()}
            row |= {"detectable": found.detectable, "pixels_outside": found.pixels_outside}
            row["difference"] = Estimate(found.difference, found.low, found.high, min(images))
            samples = " and ".join(map(str, dict.fromkeys(spp)))
            row["rests_on"] = f"{images[0]} + {images[1]} of {samples} spp{', pairs' if paired else ''}"
        table.rows.append(row)
    return table


def corrected(p: float, threshold: float) -> float:
    """The smallest of many p values corrected for their number, so that `ALPHA` is its threshold (Sidak 1967)."""
    tests = math.log1p(-ALPHA) / math.log1p(-threshold)
    return -math.expm1(tests * math.log1p(-p)) if p < 1 else 1.0


def accuracy(analysis: Analysis) -> Table:
    """Results of the accuracy suite, where the config has `verify`: the worst of each check, and every failure."""
    from harness.verify.suite import CheckResult
    from harness.verify.summary import worst_per_check

    table = Table(
        "accuracy", "Accuracy",
        "Cases of `raybench verify` that the config names. Of the passes of a case one row, with the result nearest to its "
        "tolerance and how many results it stands for; every failure has a row.",
        [Column("case", "Id of the case."), Column("description", "What the case checks."), Column("engine", "Engine."),
         Column("precision", "The setting."), Column("parameter", "What was varied."),
         Column("error", "The largest error.", "number"), Column("unit", "Unit of error and tolerance."),
         Column("tolerance", "The largest error that passes, by the precision in which the engine traces.", "number"),
         Column("outcome", "pass, fail, xfail (no tolerance in this precision) or skip."),
         Column("stands_for", "Results that the row stands for.", "count")],
    )  # fmt: skip
    results = [CheckResult.model_validate(each) for each in analysis.results.check_results]
    for result, others, _ in worst_per_check(results):
        row = {column.name: getattr(result, column.name) for column in table.columns[:-1]}
        table.rows.append(row | {"stands_for": others + 1})
    return table


def bias_text(verdict: Verdict) -> str:
    """`< 0.5 %`: none seen, that much would have been; `2.9 %, flagged`; or `unknown`."""
    bias = verdict.bias
    if bias is None or math.isnan(bias.squared):
        return "unknown"
    if bias.biased:
        return f"{100 * bias.root:.2g} %, flagged"
    seen = math.sqrt(max(bias.squared, 0.0) + 3 * bias.se)
    return f"< {100 * seen:.2g} %"


def equivalence_text(verdict: Verdict) -> str:
    if verdict.baseline is None:
        return "baseline"
    return verdict.equivalence.verdict if verdict.equivalence is not None else "unknown"


def who(verdict: Verdict) -> dict[str, Any]:
    """The first cells of a row."""
    return {"scene": verdict.contender.settings.scene, "contender": verdict.contender.name}
