"""Takes the pictures of docs/start.md from results/quick, or another run of configs/quick.yaml:
python docs/pictures/start.py [FOLDER]

Needs Chromium for the first of them, the top of the report.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
TARGET = ROOT / "docs" / "pictures" / "start"
PLOTS = ("error-over-time-cornell_box", "error-over-samples-cornell_box", "time-to-quality-cornell_box",
         "pareto-cornell_box", "targets-over-time", "phases-cornell_box", "sentinel")  # fmt: skip
WIDTH, SIZE = 760, (1100, 760)
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
         "--disable-background-networking", "--disable-component-update", "--disable-sync")  # fmt: skip


def shrunk(picture: Path, target: Path, width: int = WIDTH) -> None:
    """At most `width` wide and of 256 colours, which a plot is."""
    image = Image.open(picture).convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    image.quantize(256, dither=Image.Dither.NONE).save(target, optimize=True)


def photographed(page: Path, target: Path, window: tuple[int, int] = SIZE, width: int = WIDTH) -> None:
    """The top of a page, as a window of that many pixels shows it."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        sys.exit("no Chromium is installed")
    with tempfile.TemporaryDirectory() as profile:
        shot = Path(profile, "shot.png")
        size = f"--window-size={window[0]},{window[1]}"
        subprocess.run(
            [browser, *FLAGS, f"--user-data-dir={profile}/data", f"--screenshot={shot}", size, page.resolve().as_uri()],
            check=True, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        shrunk(shot, target, width)


def main(folder: Path) -> None:
    TARGET.mkdir(exist_ok=True)
    photographed(folder / "report.html", TARGET / "verdicts.png")
    for name in PLOTS:
        shrunk(folder / "plots" / f"{name}.png", TARGET / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "results" / "quick")
