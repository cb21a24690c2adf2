"""What every test shares: hypothesis draws the same examples in every run, and sets no time limit on one. Reports come with
SVG alone, for PNG and PDF take most of a report's time; tests/harness/test_plots.py draws them all. And one browser.
References are kept in a folder of the session: the user's own are neither read nor written."""

import os
import tempfile

import pytest
from hypothesis import settings

from tests.browser import PROGRAM, Browser

os.environ["RAYBENCH_PLOTS"] = "svg"

if "PYTEST_XDIST_WORKER" not in os.environ:  # its workers inherit the folder
    _references = tempfile.TemporaryDirectory(prefix="raybench-references-")
    os.environ["RAYBENCH_REFERENCES"] = _references.name

settings.register_profile("raybench", derandomize=True, deadline=None)
settings.load_profile("raybench")


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium. It ends with its file: Playwright keeps an event loop running in the thread of the tests."""
    if PROGRAM is None:
        pytest.skip("Chromium is not installed")
    with Browser() as browser:
        yield browser
