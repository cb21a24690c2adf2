"""Takes the README's picture of the report in results/baseline: python docs/pictures/report.py

Needs Chromium and `raybench report results/baseline`. What is seen is the top of the page: the verdicts.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 1280, 1150
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
         "--disable-background-networking", "--disable-component-update", "--disable-sync")  # fmt: skip


def main(folder: Path, target: Path) -> None:
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        sys.exit("report.py: no Chromium is installed")
    with tempfile.TemporaryDirectory() as profile:
        page = (folder / "report.html").resolve().as_uri()
        shot = [f"--screenshot={target.resolve()}", f"--window-size={WIDTH},{HEIGHT}", page]
        subprocess.run([browser, *FLAGS, f"--user-data-dir={profile}", *shot], check=True, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    main(ROOT / "results/baseline", ROOT / "docs/pictures/report.png")
