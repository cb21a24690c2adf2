"""Takes the picture of the report in results/renderers, its first screen: python docs/pictures/report.py

Needs Chromium and `raybench report results/renderers`.
"""

from start import ROOT, photographed

if __name__ == "__main__":
    photographed(ROOT / "results/renderers/report.html", ROOT / "docs/pictures/report.png", (1280, 830), 1280)
