"""Draws the README's picture from the archive of the race of renderers: python docs/pictures/race.py

Left, the scene `study` as the gallery has it; right, each renderer's error over time in that race, with 95 % intervals of the
mean error over the race's blocks.
"""

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.ticker import FuncFormatter
from PIL import Image

from harness.statistics.intervals import geometric_interval

ROOT = Path(__file__).resolve().parents[2]
SCENE = "study"
WIDTH, PICTURE = 1280, (736, 414)
CURVES = {
    ("numba", "sobol", "auto"): ("raybench, numba", "#d55e00"),
    ("mitsuba", "multijitter", "embree"): ("Mitsuba 3, its fastest setting", "#cc79a7"),
    ("cycles", "sobol", "auto"): ("Blender's Cycles", "#0072b2"),
    ("luxcore", "random", "auto"): ("LuxCoreRender", "#009e73"),
}
"""Engine, sampler and accelerator: label and colour."""


def main(archive: Path, target: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(archive, Path(folder) / "race")
        subprocess.run([sys.executable, "-m", "harness", "report", str(copy)], check=True, cwd=ROOT)
        points = pd.read_csv(copy / "points.csv")
    figure, plot = plt.subplots(figsize=((WIDTH - PICTURE[0]) / 100, PICTURE[1] / 100), layout="constrained")
    for (engine, sampler, accelerator), (label, colour) in CURVES.items():
        mine = points[
            (points.scene == SCENE)
            & (points.engine == engine)
            & points.sampler.str.startswith(sampler)
            & points.accelerator.str.startswith(accelerator)
            & points.label.isna()
            & (points.division == "closed")
        ]
        rows = []
        order = mine.sort_values("spp").groupby("block").cumcount()  # LuxCore's checkpoints differ by a few samples
        for _, group in mine.groupby(order):
            if len(group) == mine.block.nunique():  # where every block got
                seconds = np.exp(np.log(group.seconds).mean())
                rows.append((seconds, *geometric_interval(list(group["relmse_e0.01_corrected"]))[:3]))
        seconds, error, low, high = np.array(rows).T
        plot.plot(seconds, error, "o-", color=colour, label=label, ms=3, lw=1.6)
        plot.fill_between(seconds, low, high, color=colour, alpha=0.25, lw=0)
    plot.set(xscale="log", yscale="log", xlabel="seconds of rendering, two cores", ylabel="relMSE (ε = 0.01)")
    for axis in (plot.xaxis, plot.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    plot.grid(alpha=0.3)
    plot.spines[["top", "right"]].set_visible(False)
    plot.legend(frameon=False)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=100)
    both = Image.new("RGB", (WIDTH, PICTURE[1]), "white")
    both.paste(Image.open(ROOT / f"docs/pictures/gallery/{SCENE}.jpg").resize(PICTURE, Image.Resampling.LANCZOS))
    both.paste(Image.open(drawn), (PICTURE[0], 0))
    both.save(target, optimize=True)


if __name__ == "__main__":
    main(ROOT / "results/renderers", ROOT / "docs/pictures/race.png")
