"""The report's section "Is it noise or bias?": what the images of a contestant's seeds, together, say of its error."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from engines.image import png_bytes
from harness.analysis import Analysis, Verdict
from harness.analysis.axes import others
from harness.analysis.equivalence import Replicates, common_spp, pictured_spp
from harness.report.html.pictures import ranked
from harness.report.plots.panels import Panel, panels
from harness.report.tables.model import number_text
from harness.statistics.noise_or_bias import FEWEST_SEEDS, Spectrum, Welch, deviation, spectrum, welch

MOST_CONTESTANTS = 6
"""Of a panel: the best of each engine, then by error."""
WIDEST = 128
"""Pixels of a picture along its longer side, at most."""
BARS = 20
WIDTH, HEIGHT = 176, 132
"""Of the drawings, in the units of their coordinates."""
Array = NDArray[np.float64]


class NoiseOrBias(NamedTuple):
    """A contestant: pictures and drawings for the page, and what they say."""

    name: str
    basis: str
    deviation: str
    p_map: str
    histogram: Markup
    spectrum: Markup
    biased: bool
    reading: str


class NoisePanel(NamedTuple):
    """`brightest` is the deviation, in radiance, that the colour scale of the pictures ends at."""

    title: str
    brightest: str
    contestants: list[NoiseOrBias]


class _Found(NamedTuple):
    verdict: Verdict
    basis: str
    deviation: Array
    welch: Welch
    spectrum: Spectrum


def noise_panels(analysis: Analysis) -> list[NoisePanel]:
    """The panels that have contestants with images of `FEWEST_SEEDS` seeds or more, and a reference of their size."""
    images = Replicates(analysis.results, keep=1)
    found = [(panel, _examined(panel, images)) for panel in panels(analysis)]
    return [_panel(panel.title, contestants) for panel, contestants in found if contestants]


def _examined(panel: Panel, images: Replicates) -> list[_Found]:
    """Contestants that differ in threads alone have the same images at equal samples: one of them is enough."""
    found: list[_Found] = []
    seen: set[object] = set()
    for verdict in ranked(panel):
        if len(found) == MOST_CONTESTANTS:
            break
        contestant, alike = verdict.contestant, others(verdict.contestant.settings, "threads")
        if alike in seen:
            continue
        spp = _samples(verdict)
        own, reference = list(images.of(contestant, spp).values()), images.reference(contestant)
        if len(own) < FEWEST_SEEDS or reference is None or own[0].shape != reference.mean.shape:
            continue
        seen.add(alike)
        counts = pictured_spp(contestant.done, spp)
        at = f"{min(counts)} spp" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)} spp"
        basis = f"{len(own)} seeds at {at}"
        found.append(_Found(verdict, basis, deviation(own), welch(own, reference), spectrum(own, reference)))
    return found


def _samples(verdict: Verdict) -> int | None:
    """None for the last images where seeds have about as many samples there, else the most samples of which all have one."""
    last = pictured_spp(verdict.contestant.done)
    return None if last and max(last) <= 2 * min(last) else common_spp(verdict.contestant, pictured=True)


def _panel(title: str, found: Sequence[_Found]) -> NoisePanel:
    brightest = float(np.percentile(np.concatenate([each.deviation.ravel() for each in found]), 99))
    powers = np.concatenate([part[part > 0] for each in found for part in (each.spectrum.power, each.spectrum.low)])
    ends = (
        (float(powers.min()), max(float(max(each.spectrum.high.max() for each in found)), 1e-30))
        if powers.size
        else (1e-9, 1.0)
    )
    return NoisePanel(title, number_text(brightest), [_shown(each, brightest, ends) for each in found])


def _shown(found: _Found, brightest: float, ends: tuple[float, float]) -> NoiseOrBias:
    return NoiseOrBias(
        found.verdict.contestant.name,
        found.basis,
        _picture(_fitted(found.deviation) / (brightest or 1.0), "magma"),
        _picture(np.nan_to_num(found.welch.p, nan=1.0), "gray"),
        _histogram(found.welch.p[np.isfinite(found.welch.p)], found.verdict.contestant.name),
        _curves(found.spectrum, ends, found.verdict.contestant.name),
        not found.welch.uniformity.uniform,
        reading(found.welch, found.spectrum, found.verdict),
    )


def reading(found: Welch, power: Spectrum, verdict: Verdict) -> str:
    """What the histogram and the spectrum say, and whether the report's own tests of bias say so, too."""
    uniform = found.uniformity
    if not uniform.tiles:
        return "Nothing varies between seeds: no p value is known."
    share = f"{_percent(uniform.small)} of the p values are below 0.05 (5 % without bias)"
    distance = (
        f"distance from uniform {number_text(uniform.distance)}, by chance below {number_text(uniform.limit)} in 99 % of runs"
    )
    if uniform.independent < 0.9 * uniform.tiles:
        distance += f"; tiles share noise, so {uniform.tiles} count as {uniform.independent:.0f}"
    said = "Consistent with no bias"
    if not uniform.uniform:
        said = "More small p values than chance gives"
        if uniform.small <= 0.05:
            said = "Fewer small p values than chance gives, as where the reference shares noise with the images"
    said += f": {share}; {distance}."
    at = power.frequency[power.biased]
    if at.size:
        shared = float(np.clip((power.common / power.power)[power.biased].max(), 0, 1))
        said += f" All seeds have up to {_percent(shared)} of the error in common, {_frequencies(at)}."
    flags = verdict.bias.flags if verdict.bias is not None else []
    tests = "find bias" if flags else "find no bias"
    if flags or not uniform.uniform:
        tests += ", too" if flags and not uniform.uniform else ", though"
    return f"{said} The tests of pixels, tiles and image mean {tests}." if verdict.bias is not None else said


def _frequencies(at: Array) -> str:
    first, last = (number_text(float(value)) for value in (at.min(), at.max()))
    return f"at {first} cycles per pixel" if first == last else f"between {first} and {last} cycles per pixel"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _fitted(values: Array) -> Array:
    """(h, w) shrunk by a whole factor to at most `WIDEST` pixels, by means."""
    factor = math.ceil(max(values.shape) / WIDEST)
    rows, columns = (max(size // factor, 1) for size in values.shape)
    return values[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor).mean(axis=(1, 3))


def _picture(shares: Array, colours: str) -> str:
    """Values (h, w) from 0 to 1 in a colour map, as an address of a PNG."""
    from matplotlib import colormaps

    bitmap = (255 * colormaps[colours](np.clip(shares, 0.0, 1.0))[..., :3]).round().astype(np.uint8)
    return "data:image/png;base64," + base64.b64encode(png_bytes(bitmap)).decode()


def _histogram(p: Array, name: str) -> Markup:
    """Bars of the p values, with a line at the height that uniform ones have."""
    counts = np.histogram(p, BARS, (0.0, 1.0))[0] / max(p.size, 1)
    most = max(float(counts.max()), 2.0 / BARS)
    wide = WIDTH / BARS
    bars = "".join(
        f'<rect x="{i * wide + 0.5:.1f}" y="{HEIGHT * (1 - share / most):.1f}" width="{wide - 1:.1f}" '
        f'height="{HEIGHT * share / most:.1f}"/>'
        for i, share in enumerate(counts)
    )
    level = HEIGHT * (1 - 1 / BARS / most)
    line = f'<line x1="0" x2="{WIDTH}" y1="{level:.1f}" y2="{level:.1f}"/>'
    words = f"Histogram of the p values of {name}: {_percent(float((p < 0.05).mean()) if p.size else 0.0)} are below 0.05"
    return _drawing(bars + line, "histogram", words, ("0", "p value", "1"))


def _curves(found: Spectrum, ends: tuple[float, float], name: str) -> Markup:
    """Power over frequency on logarithmic axes: the range of seeds, the mean, and where it is clear what all have in common."""
    x = np.log(found.frequency)
    across = WIDTH * (x - x[0]) / ((x[-1] - x[0]) or 1.0)
    low, high = np.log(ends[0]) - 2.3, np.log(ends[1])  # a tenth below the smallest power

    def up(values: Array) -> Array:
        logs = np.log(np.maximum(values, 1e-300))
        return HEIGHT * (1 - np.clip((logs - low) / ((high - low) or 1.0), 0.0, 1.0))

    def points(*parts: tuple[Array, Array]) -> str:
        return " ".join(f"{a:.1f},{b:.1f}" for xs, ys in parts for a, b in zip(xs, ys, strict=True))

    band = points((across, up(found.high)), (across[::-1], up(found.low)[::-1]))
    drawn = f'<polygon points="{band}"/><polyline points="{points((across, up(found.power)))}"/>'
    at, height = across[found.biased], up(found.common[found.biased])
    drawn += "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3"/>' for a, b in zip(at, height, strict=True))
    first, last = (number_text(float(value)) for value in found.frequency[[0, -1]])
    words = f"Squared error of {name} over {first} to {last} cycles per pixel, mean and range of seeds"
    return _drawing(drawn, "spectrum", words, (first, "cycles per pixel", last))


def _drawing(inside: str, kind: str, words: str, labels: tuple[str, str, str]) -> Markup:
    """An SVG that shows what `words` say, with labels at the start, the middle and the end of its lower edge."""
    places = zip(labels, (0, WIDTH / 2, WIDTH), ("start", "middle", "end"), strict=True)
    texts = "".join(f'<text x="{x:g}" y="{HEIGHT + 12}" text-anchor="{anchor}">{text}</text>' for text, x, anchor in places)
    axis = f'<path d="M0 0V{HEIGHT}H{WIDTH}"/>'
    box = f'viewBox="-4 -4 {WIDTH + 8} {HEIGHT + 20}"'
    return Markup(f'<svg class="{kind}" {box} role="img" aria-label="{escape(words)}">{inside}{axis}{texts}</svg>')
