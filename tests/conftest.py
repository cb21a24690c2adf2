"""What every test shares: hypothesis draws the same examples in every run, and sets no time limit on one. Reports come with
SVG alone, for PNG and PDF take most of a report's time; tests/harness/test_plots.py draws them all."""

import os

from hypothesis import settings

os.environ["RAYBENCH_PLOTS"] = "svg"

settings.register_profile("raybench", derandomize=True, deadline=None)
settings.load_profile("raybench")
