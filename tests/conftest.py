"""What every test shares: hypothesis draws the same examples in every run, and sets no time limit on one. Reports come with
SVG alone, for PNG and PDF take most of a report's time; tests/harness/test_plots.py draws them all. References are kept in
a folder of the session: the user's own are neither read nor written."""

import os
import tempfile

from hypothesis import settings

os.environ["RAYBENCH_PLOTS"] = "svg"

if "PYTEST_XDIST_WORKER" not in os.environ:  # its workers inherit the folder
    _references = tempfile.TemporaryDirectory(prefix="raybench-references-")
    os.environ["RAYBENCH_REFERENCES"] = _references.name

settings.register_profile("raybench", derandomize=True, deadline=None)
settings.load_profile("raybench")
