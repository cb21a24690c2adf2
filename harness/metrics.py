"""How far a rendered image is from its reference: every number that a checkpoint is scored with.

Images are (h, w, 3) linear radiance, the reference comes with two independent halves so that its own noise can be
taken out. Metric names carry their parameters (`relmse_e0.01`). Non-finite pixels are counted, never dropped: an
image that holds one has infinite error and unknown (NaN) perceptual scores.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.tonemap import srgb

Image = NDArray[np.float64]

METRICS = ("relmse", "trimmed_relmse", "mse", "mae", "mape", "smape", "psnr", "ssim", "flip")
"""Those that targets may be set on."""
PERCENTAGE_EPSILON = 0.01
"""The offset of MAPE and SMAPE in radiance units, as in tev."""
TRIMMED_FRACTION = 0.001
_TRIMMED = "_trimmed"
"""Ends the name of the relMSE without the largest `TRIMMED_FRACTION` of the pixels' errors."""
LATTICE = 8
"""Standard errors come from LATTICE^2 interleaved groups of pixels."""

METRIC_MEANINGS = {
    "relmse": "mean((A-R)^2 / (R^2 + eps)) over pixels and channels (Rousselle et al. 2011); eps is in the name",
    "relmse_corrected": "mean((A-R1)(A-R2) / (R^2 + eps)): the reference's own noise cancels; may be negative",
    "relmse_se": "standard error of the corrected relMSE by the noise of the reference",
    "relmse_trimmed": "relMSE without the 0.1 % of pixels where it is largest; the metric `trimmed_relmse`",
    "mse": "mean((A-R)^2), radiance squared",
    "mse_corrected": "mean((A-R1)(A-R2)), radiance squared; may be negative",
    "mse_se": "standard error of the corrected MSE by the noise of the reference",
    "mae": "mean(|A-R|), in units of radiance",
    "mape": "mean(|A-R| / (|R| + 0.01))",
    "smape": "mean(|A-R| / ((|A|+|R|)/2 + 0.01))",
    "psnr": "10 log10(1 / MSE) in dB of sRGB-encoded, clipped images",
    "ssim": "structural similarity of sRGB-encoded, clipped images (Gaussian window of 11 pixels, sigma 1.5)",
    "flip": "mean FLIP (LDR, 67 pixels per degree) of sRGB-encoded, clipped images",
    **{
        f"{name}_se": f"how far the reference's noise moves {what}, from the scores against its halves; of the targets' metric"
        for name, what in (
            ("relmse_trimmed", "the trimmed relMSE"),
            ("mae", "MAE"),
            ("mape", "MAPE"),
            ("smape", "SMAPE"),
            ("psnr", "the MSE from which PSNR follows"),
            ("ssim", "1 - SSIM"),
            ("flip", "FLIP"),
        )
    },
    "nonfinite": "pixels with a NaN or infinite channel",
    "mean": "mean radiance of a channel over the image",
}


class Margins(NamedTuple):
    """How far equivalent images may lie apart, as shares: `image` of the mean radiance, `tile` of a tile's."""

    image: float = 0.005
    tile: float = 0.05


DEFAULT_MARGINS = Margins()


@dataclass(frozen=True)
class Reference:
    """A converged image: `mean` (h, w, 3), two independent halves of it, and `variance`, the variance of `mean`.

    `spp` is the samples per pixel of `mean`; each half has half of them.
    """

    mean: Image
    half_1: Image
    half_2: Image
    variance: Image
    spp: int


def measure(image: Image, reference: Reference, epsilon: float, metric: str = "") -> dict[str, float]:
    """All metrics of `image` (h, w, 3) against `reference`; METRIC_MEANINGS explains the keys.

    `metric` is the one that targets are set on: it has a standard error by the reference's noise, which relMSE and MSE
    have always. Raises ValueError where the shapes differ or `epsilon` is not positive.
    """
    image = np.asarray(image, np.float64)
    if image.shape != reference.mean.shape:
        raise ValueError(f"image of shape {image.shape}, reference of shape {reference.mean.shape}: must be equal")
    if not epsilon > 0:
        raise ValueError(f"epsilon = {epsilon!r}: must be positive")
    nonfinite = int((~np.isfinite(image).all(axis=2)).sum())
    with np.errstate(invalid="ignore", over="ignore"):
        scores = {**_errors(image, reference, epsilon), **_display_scores(image, reference.mean, nonfinite == 0)}
        if _uncorrected(metric) is not None:
            scores[f"{metric}_se"] = math.inf if nonfinite else noise_by_halves(metric, image, reference)
        means = {f"mean_{name}": float(image[:, :, channel].mean()) for channel, name in enumerate("rgb")}
    if nonfinite:
        scores = {key: math.inf if key not in _display_keys() else value for key, value in scores.items()}
    return {**scores, "nonfinite": float(nonfinite), **means}


def metric_name(metric: str, epsilon: float) -> str:
    """The column of a config's metric: with epsilon 0.01 `relmse` is `relmse_e0.01`, `trimmed_relmse` `relmse_e0.01_trimmed`;
    others carry no parameter."""
    return {"relmse": f"relmse_e{epsilon:g}", "trimmed_relmse": f"relmse_e{epsilon:g}{_TRIMMED}"}.get(metric, metric)


def epsilon_of(name: str) -> float | None:
    """The epsilon in a metric's name; None where it has none. Raises ValueError for one that is no number."""
    return float(name.removeprefix("relmse_e").removesuffix(_TRIMMED)) if name.startswith("relmse_e") else None


def metric_title(name: str) -> str:
    """A metric's name for people: `relmse_e0.01` is `relMSE (ε = 0.01)`."""
    if (epsilon := epsilon_of(name)) is not None:
        return f"{'trimmed ' * name.endswith(_TRIMMED)}relMSE (ε = {epsilon:g})"
    return f"{name.upper()} (ε = {PERCENTAGE_EPSILON:g})" if name in ("mape", "smape") else name.upper()


def higher_is_better(metric: str) -> bool:
    return metric in ("psnr", "ssim")


def as_error(metric: str, value: float) -> float:
    """A quality as an error that falls: PSNR as the MSE it stands for, SSIM as 1 - SSIM, errors as they are."""
    if metric == "psnr":
        return 10 ** (-value / 10)
    return 1 - value if metric == "ssim" else value


def error_words(metric: str) -> str:
    """What errors are where qualities rise, and whether the reference's noise has been taken out of them."""
    if metric == "mse" or (metric.startswith("relmse_e") and not metric.endswith(_TRIMMED)):
        return "noise-corrected"
    error = {"psnr": "MSE of display values (from PSNR), ", "ssim": "1 - SSIM, "}.get(metric, "")
    return f"{error}not corrected for the reference's noise"


def reference_noise(image: Image, reference: Reference, epsilon: float | None = None) -> float:
    """Standard error by the noise of the reference: of the corrected relMSE, without `epsilon` of the corrected MSE.

    With e = A - R its square is the sum over pixels of (sum over channels of w e (R1 - R2))^2, over N^2 for N pixels times
    channels. R1 - R2 has the variance of R1 + R2, by which each product (A-R1)(A-R2) errs, and is uncorrelated with it. w is
    1 for MSE. For relMSE it is (1 + e R / d) / d, since the denominator d = R^2 + eps errs as well: without that term the
    result is several times too small where e is larger than R. And the noise of d shifts the expectation, by the mean of
    e^2 v (4 R^2 / d - 1) / d^2 with v = (R1 - R2)^2 / 4, which is added to the standard error (root of squares). The
    noises of a pixel's channels may be correlated, those of different pixels are not.
    """
    error, difference = image - reference.mean, reference.half_1 - reference.half_2
    parts, shift = error * difference, 0.0
    if epsilon is not None:
        denominator = reference.mean**2 + epsilon
        share = reference.mean**2 / denominator
        shift = float(((parts / denominator) ** 2 * (share - 0.25)).mean())
        parts *= (1.0 + error * reference.mean / denominator) / denominator
    return math.hypot(math.sqrt((parts.sum(axis=2) ** 2).sum()) / parts.size, shift)


def noise_by_halves(metric: str, image: Image, reference: Reference) -> float:
    """How far the reference's noise moves a metric that is not corrected for it (`as_error`), from scores against its halves.

    A half has twice the variance. What a score's expectation grows by, in proportion to the variance while the noise is
    small beside the error, is thus the mean score of the halves less that of the reference; and half the difference
    of the halves' scores has the spread of their mean. The root of the sum of both squares.
    """
    score = _uncorrected(metric)
    if score is None:
        raise ValueError(f"{metric}: a metric that is not corrected for the reference's noise is expected")
    whole, *halves = (as_error(metric, score(image, other)) for other in (reference.mean, reference.half_1, reference.half_2))
    return math.hypot(sum(halves) / 2 - whole, (halves[0] - halves[1]) / 2)


def corrected_error_map(image: Image, reference: Reference, epsilon: float) -> Image:
    """(h, w, 3): (A-R1)(A-R2) / (R^2 + eps), whose expectation holds no noise of the reference.

    R in the denominator is noisy itself, which shifts it: see `reference_noise`.
    """
    return (image - reference.half_1) * (image - reference.half_2) / (reference.mean**2 + epsilon)


def lattice_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of `values` (h, w[, c]) over up to 64 interleaved groups: the pixels of equal x mod 8 and y mod 8.

    Every group sees the whole picture, so the spread of the groups holds noise and hardly any structure.
    """
    step_y, step_x = min(LATTICE, values.shape[0]), min(LATTICE, values.shape[1])
    return np.array([values[y::step_y, x::step_x].mean() for y in range(step_y) for x in range(step_x)])


def standard_error(values: NDArray[np.float64]) -> float:
    """Standard error of the mean of `values` (h, w[, c]) over interleaved groups; NaN for a single pixel."""
    groups = lattice_means(values)
    return float(groups.std(ddof=1) / math.sqrt(groups.size)) if groups.size > 1 else math.nan


def _errors(image: Image, reference: Reference, epsilon: float) -> dict[str, float]:
    """The metrics of linear radiance."""
    name = f"relmse_e{epsilon:g}"
    mean = reference.mean
    difference = image - mean
    relative = difference**2 / (mean**2 + epsilon)
    return {
        name: float(relative.mean()),
        f"{name}_corrected": float(corrected_error_map(image, reference, epsilon).mean()),
        f"{name}_se": reference_noise(image, reference, epsilon),
        f"{name}_trimmed": _trimmed_mean(relative),
        "mse": float((difference**2).mean()),
        "mse_corrected": float(((image - reference.half_1) * (image - reference.half_2)).mean()),
        "mse_se": reference_noise(image, reference),
        "mae": _mae(image, mean),
        "mape": _mape(image, mean),
        "smape": _smape(image, mean),
    }


def _mae(image: Image, mean: Image) -> float:
    return float(abs(image - mean).mean())


def _mape(image: Image, mean: Image) -> float:
    return float((abs(image - mean) / (abs(mean) + PERCENTAGE_EPSILON)).mean())


def _smape(image: Image, mean: Image) -> float:
    return float((abs(image - mean) / ((abs(image) + abs(mean)) / 2 + PERCENTAGE_EPSILON)).mean())


def _trimmed_mean(values: Image) -> float:
    """Mean over pixels without the largest 0.1 % of them (rounded up), a pixel being the mean of its channels."""
    pixels = np.sort(values.mean(axis=2), axis=None)
    kept = max(pixels.size - math.ceil(TRIMMED_FRACTION * pixels.size), 1)
    return float(pixels[:kept].mean())


def _display_keys() -> tuple[str, ...]:
    return ("psnr", "ssim", "flip") if find_spec("flip_evaluator") else ("psnr", "ssim")


def _display_scores(image: Image, mean: Image, finite: bool) -> dict[str, float]:
    """Scores of what an eye sees: both images clipped to [0, 1] and sRGB-encoded."""
    if not finite:
        return dict.fromkeys(_display_keys(), math.nan)
    shown, expected = srgb(image), srgb(mean)
    return {key: _DISPLAY[key](shown, expected) for key in _display_keys()}


def _psnr(shown: Image, expected: Image) -> float:
    mse = float(((shown - expected) ** 2).mean())
    return -10.0 * math.log10(mse) if mse > 0 else math.inf


def _ssim(shown: Image, expected: Image) -> float:
    """Wang et al. 2004 with its original window; NaN for images narrower than the window."""
    from skimage.metrics import structural_similarity

    if min(shown.shape[:2]) < 11:
        return math.nan
    score = structural_similarity(
        shown, expected, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    return float(np.mean(score))


def _flip(shown: Image, expected: Image) -> float:
    """Andersson et al. 2020. The evaluator hides NaN: only finite images may come here."""
    import flip_evaluator  # pyright: ignore[reportMissingImports]

    pair = (np.ascontiguousarray(expected, np.float32), np.ascontiguousarray(shown, np.float32))
    return float(flip_evaluator.evaluate(*pair, "LDR", applyMagma=False)[1])


_DISPLAY: dict[str, Callable[[Image, Image], float]] = {"psnr": _psnr, "ssim": _ssim, "flip": _flip}
"""Scores of two images that are clipped and sRGB-encoded."""
_UNCORRECTED: dict[str, Callable[[Image, Image], float]] = {
    "mae": _mae,
    "mape": _mape,
    "smape": _smape,
    **{key: lambda image, mean, score=score: score(srgb(image), srgb(mean)) for key, score in _DISPLAY.items()},
}
"""Scores of two images of linear radiance that hold the reference's noise."""


def _uncorrected(metric: str) -> Callable[[Image, Image], float] | None:
    """The score of a metric that holds the reference's noise; None of one that is corrected for it."""
    epsilon = epsilon_of(metric)
    if epsilon is None or not metric.endswith(_TRIMMED):
        return _UNCORRECTED.get(metric)
    return lambda image, mean: _trimmed_mean((image - mean) ** 2 / (mean**2 + epsilon))
