"""Draws the plots of docs/how/hard_cases.md: python docs/pictures/hard_cases.py [FOLDER]

The textbook formulas are computed here in a few lines; raybench's results come from `trace` of the engine numpy. The
last plots are of results/stability, or another run of configs/stability.yaml.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

import engines
from harness.report.plots import stability
from harness.report.plots.figures import figure as drawn
from harness.report.plots.figures import style
from harness.store.results import load_results
from harness.trace import oracle

ROOT = Path(__file__).resolve().parents[2]
TARGET = ROOT / "docs" / "pictures" / "hard_cases"
OURS, BOOK, BOOK32 = "#009e73", "#d55e00", "#e69f00"
CAMERA = {"type": "perspective", "eye": [0, 0, 9], "target": [0, 0, 0]}


def tracer(*shapes: dict[str, Any]) -> engines.Renderer:
    """The engine numpy before these shapes."""
    given = [{**shape, "material": "grey"} for shape in shapes]
    scene = {"raybench_scene": 1, "camera": CAMERA, "materials": {"grey": {"kd": 0.5}}, "shapes": given}
    return engines.engine("numpy").prepare(engines.scene_from(scene), engines.Settings(4, 4))


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def median(values: np.ndarray) -> float:
    """Not 0, which no logarithmic axis shows."""
    return max(float(np.median(values)), 1e-17)


def sphere() -> Figure:
    """Error of t over the distance of a unit sphere; rays are rounded to the precision first and are exact from there."""
    distances, rng = 10.0 ** np.arange(0.5, 8.1, 0.5), np.random.default_rng(1)
    renderer = tracer({"sphere": {"center": [0, 0, 0], "radius": 1}})
    ours, book, book32 = [], [], []
    for distance in distances:
        o = unit(rng.normal(size=(400, 3))) * distance
        d = unit(unit(rng.normal(size=(400, 3))) * 0.6 - o)
        ours.append(median(oracle.absolute(renderer.trace(o, d).t, _nearest(o, d))))
        for errors, kind in ((book, np.float64), (book32, np.float32)):
            p, q = o.astype(kind), d.astype(kind)
            a, b, c = (q * q).sum(1), 2 * (p * q).sum(1), (p * p).sum(1) - kind(1)
            t = (-b - np.sqrt(np.maximum(b * b - 4 * a * c, 0))) / (2 * a)
            exact = _nearest(p, q)
            hit = np.array([x.is_finite() for x in exact])
            errors.append(median(oracle.absolute(t[hit], exact[hit])))
    figure, axes = _new("distance of a unit sphere [m]", "error of t [m]")
    for errors, colour, label in (
        (book32, BOOK32, "b² - 4ac, float32"),
        (book, BOOK, "b² - 4ac, float64"),
        (ours, OURS, "nearest point first, float64"),
    ):
        axes.loglog(distances, errors, "o-", color=colour, label=label)
    axes.legend()
    return figure


def _nearest(o: np.ndarray, d: np.ndarray) -> Any:
    return oracle.sphere_roots(np.zeros(3), 1.0, o, d)[0]


def edges() -> Figure:
    """Share of rays, aimed at shared vertices of a sphere of triangles, that slip through."""
    sphere = {"procedural": {"name": "tessellated_sphere", "subdivisions": 4}}
    scene = engines.scene_from(
        {"raybench_scene": 1, "camera": CAMERA, "materials": {"grey": {"kd": 0.5}}, "shapes": [{**sphere, "material": "grey"}]}
    )
    mesh = cast(Any, scene.shapes[0])
    rng = np.random.default_rng(2)
    aims = mesh.vertices[rng.integers(0, len(mesh.vertices), 1500)]
    o = unit(rng.normal(size=aims.shape)) * 0.4
    d = unit(aims - o)
    shares = [_slipped(mesh, o, d, np.float32), _slipped(mesh, o, d, np.float64)]
    shares.append(float(np.isinf(tracer(sphere).trace(o, d).t).mean()))
    figure, axes = _new("", "rays that find a hole [%]")
    names = ["Möller-Trumbore\nfloat32", "Möller-Trumbore\nfloat64", "exact edge signs\nfloat64"]
    bars = axes.bar(names, [100 * share for share in shares], color=[BOOK32, BOOK, OURS], width=0.6)
    axes.bar_label(bars, [f"{100 * share:.2g}" if share else "0" for share in shares])
    axes.grid(axis="x", visible=False)
    return figure


def _slipped(mesh: Any, o: np.ndarray, d: np.ndarray, kind: Any) -> float:
    corners = mesh.vertices[mesh.faces].astype(kind)
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    missed = 0
    with np.errstate(all="ignore"):
        for origin, direction in zip(o.astype(kind), d.astype(kind), strict=True):
            p, s = np.cross(direction, e2), origin - a
            det = (e1 * p).sum(1)
            u, q = (s * p).sum(1) / det, np.cross(s, e1)
            v, t = (direction * q).sum(1) / det, (e2 * q).sum(1) / det
            missed += not ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any()
    return missed / len(o)


def offsets() -> Figure:
    """Rays that leave a unit sphere at a distance from the origin, in float32: how many meet it again at once."""
    places, rng = 10.0 ** np.arange(0, 6.1, 0.5), np.random.default_rng(3)
    again: dict[str, list[float]] = {"book": [], "ours": []}
    for place in places:
        center = np.full(3, place, np.float32)
        n = unit(rng.normal(size=(4000, 3))).astype(np.float32)
        point = center + n
        d = unit(rng.normal(size=n.shape)).astype(np.float32)
        d *= np.where((d * n).sum(1) < 0, np.float32(-1), np.float32(1))[:, None]
        size = np.abs(point).max(1, initial=0.0)[:, None]
        for name, far in (("book", np.float32(1e-4)), ("ours", 256 * np.finfo(np.float32).eps * size)):
            f = (point + n * far).astype(np.float64) - center
            inside = (f * f).sum(1) < 1
            again[name].append(100 * float(inside.mean()))
    figure, axes = _new("coordinates of the scene [m]", "rays that hit the surface they left [%]")
    axes.semilogx(places, again["book"], "o-", color=BOOK, label="constant offset of 1e-4")
    axes.semilogx(places, again["ours"], "s-", color=OURS, label="256 ulps of the largest coordinate")
    axes.legend()
    return figure


def pairs() -> Figure:
    """Two dimensions of a Halton sequence: one base for both, and two."""
    figure = Figure(figsize=(5.6, 2.9), layout="constrained")
    for axes, bases, colour in zip(figure.subplots(1, 2), ((2, 2), (2, 3)), (BOOK, OURS), strict=True):
        axes.plot(*[[_mirrored(i, base) for i in range(256)] for base in bases], "o", color=colour, ms=2.5)
        axes.set(title=f"bases {bases[0]} and {bases[1]}", aspect="equal", xlim=(0, 1), ylim=(0, 1))
        axes.set(xticks=[0, 0.5, 1], yticks=[0, 0.5, 1])
    return figure


def _mirrored(index: int, base: int) -> float:
    value, scale = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value, scale = value + digit * scale, scale / base
    return value


def brightness() -> Figure:
    """p values of tiles, of equal images and of images 1 % apart in brightness: a shift that no single test sees."""
    rng, tiles, replicates = np.random.default_rng(4), 1024, 16
    figure, axes = _new("p value of a tile", "share of tiles below")
    grid = np.linspace(0, 1, 201)
    for shift, colour, name in ((0.0, OURS, "equal"), (0.01, BOOK, "1 % brighter")):
        first = rng.normal(1, 0.03, (replicates, tiles))
        second = rng.normal(1 + shift, 0.03, (replicates, tiles))
        p = np.asarray(stats.ttest_ind(first, second, equal_var=False).pvalue)
        ks = stats.kstest(p, "uniform", alternative="greater").pvalue
        least = -np.expm1(tiles * np.log1p(-p.min()))
        label = f"{name}: Šidák {least:.2g}, Kolmogorov-Smirnov {ks:.1g}"
        axes.plot(grid, [(p <= x).mean() for x in grid], color=colour, label=label)
    axes.plot([0, 1], [0, 1], ":", color="#777777")
    axes.legend(loc="lower right")
    return figure


def roulette() -> Figure:
    """A closed furnace: the radiance gathered up to a depth, with roulette right and as the dissertation's code has it."""
    depths = np.arange(1, 13)
    figure, axes = _new("segments of a path", "radiance (truth: 1)")
    axes.plot(depths, 1 - 0.5**depths, "o-", color=OURS, label="divided by the survival, 1/2")
    wrong = 0.5 + 0.25 * (depths - 1)
    axes.plot(depths, wrong, "s-", color=BOOK, label="divided by 1/4: each bounce as bright as the first")
    axes.axhline(1, color="#777777", ls=":")
    axes.legend()
    return figure


def _new(x: str, y: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(5.6, 3), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=x, ylabel=y)
    return figure, axes


def saved(figure: Figure, name: str) -> None:
    figure.savefig(TARGET / f"{name}.png", dpi=110, facecolor="white", metadata={"Software": "raybench"})


def main(results: Path) -> None:
    TARGET.mkdir(exist_ok=True)
    makers: tuple[Callable[[], Figure], ...] = (sphere, edges, offsets, roulette, pairs, brightness)
    with style():
        for make in makers:
            saved(make(), make.__name__)
        for plot in stability.plots(load_results(results).check_results):
            saved(drawn(plot.chart), plot.name)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "results" / "stability")
