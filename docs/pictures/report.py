"""Takes the picture of the report in results/baseline, its first screen: python docs/pictures/report.py

Needs Chromium and `raybench report results/baseline`.
"""

from start import ROOT, photographed

if __name__ == "__main__":
    photographed(ROOT / "results/baseline/report.html", ROOT / "docs/pictures/report.png", (1280, 830), 1280)
