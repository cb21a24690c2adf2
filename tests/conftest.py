"""What every test shares: hypothesis draws the same examples in every run, and sets no time limit on one. Reports come
without plots, which take most of a report's time, unless a test asks for `with_plots`. And one browser.
References are kept in a folder of the session: the user's own are neither read nor written.

Temporary files lie in memory where there is such a file system, unless TMPDIR says where: results are synced to the disk
line by line, and a run waits for it a thousand times. What a killed process has written is there in either case."""

import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from tests import needs
from tests.browser import Browser

os.environ["RAYBENCH_PLOTS"] = "none"

HERE = Path(__file__).resolve().parent
IN_MEMORY = Path("/dev/shm")
ROOM = 2 << 30
"""Bytes that must be free there: the tests of a whole session leave some hundred MiB."""


def _in_memory() -> bool:
    """Whether files can be kept in memory, and programs among them be run."""
    if "TMPDIR" in os.environ or not os.access(IN_MEMORY, os.W_OK):
        return False
    there = os.statvfs(IN_MEMORY)
    return not there.f_flag & os.ST_NOEXEC and there.f_bavail * there.f_frsize >= ROOM


if "PYTEST_XDIST_WORKER" not in os.environ:  # its workers inherit the folders
    if _in_memory():
        _temporary = tempfile.TemporaryDirectory(prefix="raybench-", dir=IN_MEMORY, ignore_cleanup_errors=True)
        os.environ["TMPDIR"] = tempfile.tempdir = _temporary.name
    _references = tempfile.TemporaryDirectory(prefix="raybench-references-")
    os.environ["RAYBENCH_REFERENCES"] = _references.name
    _found = tempfile.TemporaryDirectory(prefix="raybench-needs-")
    os.environ[needs.RESULTS] = _found.name

providers._get_local_constants = lambda: providers._local_constants
"""No constants of the sources among the examples: these would depend on which modules were imported before, and reading them
all takes ten seconds."""
settings.register_profile("raybench", derandomize=True, deadline=None)
settings.load_profile("raybench")


LONG = (
    "docs/test_site.py",
    "docs/test_guides.py",
    "conformance/test_engines.py",
    "mitsuba/test_agreement.py",
    "view/test_server.py",
    "docs/test_extend.py",
    "test_features_agree.py",
    "kernels/test_accelerators.py",
    "view/test_view_page.py",
    "view/test_race_page.py",
    "harness/test_plots.py",
    "harness/test_cli.py",
    "harness/test_full_disk.py",
    "harness/test_certificates.py",
    "harness/test_cluster.py",
    "harness/test_source_hashes.py",
    "harness/test_report.py",
    "harness/test_results_from_elsewhere.py",
    "harness/test_remeasure.py",
    "harness/test_cheats.py",
    "harness/test_wrong_engines.py",
    "harness/test_archive.py",
    "kernels/test_analytic_shapes.py",
    "docs/test_pages.py",
    "external/test_sweeps.py",
    "fuzz/test_fuzz.py",
)
"""Files that take long, the longest first. They start first: otherwise one worker has them left when the others are done."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """One more than the cores: tests wait for processes, time-outs and disks."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_configure(config):
    """The order is that of `pytest_collection_modifyitems`, and not pytest-xdist's, by the number of a file's tests."""
    config.option.loadscopereorder = False
    config.pluginmanager.register(needs.Plugin())


def pytest_collection_modifyitems(items):
    places = {HERE / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path, len(LONG)))


@pytest.fixture
def with_plots(monkeypatch):
    """Reports come with plots, as SVG alone; tests/harness/test_plots.py draws all formats."""
    monkeypatch.setenv("RAYBENCH_PLOTS", "svg")


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium. It ends with its file: Playwright keeps an event loop running in the thread of the tests."""
    with Browser() as browser:
        yield browser
