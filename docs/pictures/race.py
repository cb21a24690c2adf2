"""Draws the README's picture from results/quick, which `make bench` measures: python docs/pictures/race.py"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd

import engines
from harness.report.plots.style import ENGINE_COLOURS

ROOT = Path(__file__).resolve().parents[2]
NAMES = {"numpy": "numpy (float64)", "numba": "numba (float32)", "embree": "embree (float32)"}


def main(folder: Path, target: Path) -> None:
    points = pd.read_csv(folder / "points.csv")
    scenes = ["cornell_box", "two_spheres"]
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), width_ratios=[1, 1.55], layout="constrained")
    for (picture, plot), scene in zip(axes, scenes, strict=True):
        settings = engines.Settings(320, 240, shader="path_tracer", sampler="sobol", threads=2, precision="float32")
        film = engines.engine("numba").prepare(engines.load_scene(scene), settings).render(512)
        picture.imshow(film.to_bitmap())
        picture.set_axis_off()
        picture.set_title(scene.replace("_", " "), loc="left", fontsize=11)
        for engine, label in NAMES.items():
            mine = points[(points.scene == scene) & (points.engine == engine) & points.label.isna()]
            groups = mine.groupby("spp")[["seconds", "relmse_e0.01_corrected"]]
            curves = groups.median()[groups.size() == mine.block.nunique()]  # where every seed got
            plot.plot(curves.seconds, curves["relmse_e0.01_corrected"], "o-", color=ENGINE_COLOURS[engine], label=label, ms=4)
        plot.set(xscale="log", yscale="log", ylabel="relative MSE")
        plot.grid(alpha=0.3)
        plot.spines[["top", "right"]].set_visible(False)
    axes[1, 1].set_xlabel("seconds of rendering, warm, two threads")
    axes[0, 1].legend(frameon=False)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(ROOT / "results/quick", ROOT / "docs/pictures/race.png")
