"""Takes the pictures of docs/start.md from results/quick, or another run of configs/quick.yaml:
python docs/pictures/start.py [FOLDER]

The first picture of that page is that of docs/pictures/report.py.
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.browser import PROGRAM, Browser  # noqa: E402

TARGET = ROOT / "docs" / "pictures" / "start"
PLOTS = (
    "error-over-time-cornell_box",
    "error-over-samples-cornell_box",
    "time-to-quality-cornell_box",
    "pareto-cornell_box",
    "targets-over-time",
    "phases-cornell_box",
)
WIDTH = 760


def shrunk(picture: Path, target: Path, width: int = WIDTH) -> None:
    """At most `width` wide and of 256 colours, which a plot is."""
    image = Image.open(picture).convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    image.quantize(256, dither=Image.Dither.NONE).save(target, optimize=True)


def photographed(page: Path, target: Path, window: tuple[int, int], width: int) -> None:
    """The top of a page, as a window of that many pixels shows it."""
    if PROGRAM is None:
        sys.exit("no Chromium is installed")
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        browser.open(page, *window)
        browser.picture(Path(folder, "shot.png"))
        shrunk(Path(folder, "shot.png"), target, width)


def main(folder: Path) -> None:
    TARGET.mkdir(exist_ok=True)
    for name in PLOTS:
        shrunk(folder / "plots" / f"{name}.png", TARGET / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "results" / "quick")
