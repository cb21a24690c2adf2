"""What tests need that not every machine has, as a marker: `@needs("mitsuba-llvm")`.

A row of `NEEDS` is a program that *uses* the thing. It runs in a process of its own, at most once a session, when a test that
needs it is about to run. It fails with the reason in its last line; then the test is skipped, or fails if the variable
`RAYBENCH_REQUIRE` names the thing: `RAYBENCH_REQUIRE=mitsuba-llvm,chromium make test`. Every thing is a marker of its own
besides: `-m mitsuba_llvm` chooses the tests that need it.
"""

import fcntl
import os
import signal
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
REQUIRED, RESULTS = "RAYBENCH_REQUIRE", "RAYBENCH_TESTS_NEED"
"""Variables: names that must not be lacking, and the session's folder of what programs found."""
SECONDS = 300
PREFIX = "lacks "

MITSUBA = """
import sys
import numpy
from engines.peers.mitsuba import library
reason = library.lacking(library.{variant})
if reason:
    sys.exit(reason)
mi, _ = library.activate(library.{variant}, 1)
film = {{"type": "hdrfilm", "width": 4, "height": 4}}
parts = {{"ball": {{"type": "sphere", "center": [0, 0, 5]}}, "sky": {{"type": "constant"}}}}
scene = mi.load_dict({{"type": "scene", "eye": {{"type": "perspective", "film": film}}, **parts}})
image = mi.render(scene, integrator=mi.load_dict({{"type": "path", "max_depth": 2}}), spp=4)
assert 0.1 < numpy.array(image).mean() < 1.1
"""
CHROMIUM = """
import sys
from tests.browser import PROGRAM, Browser
if PROGRAM is None:
    sys.exit("no chromium, chromium-browser or google-chrome is on PATH")
with Browser() as browser:
    assert browser.page.evaluate("6 * 7") == 42
"""
CYCLES = """
import os, subprocess, sys
from pathlib import Path
python = Path(os.environ.get("RAYBENCH_CYCLES_PYTHON", sys.executable))
python = python / "bin" / "python" if python.is_dir() else python
use = "import bpy; bpy.context.scene.render.engine = 'CYCLES'"
done = subprocess.run([python, "-c", use], capture_output=True, text=True)
if done.returncode:
    sys.exit(f"RAYBENCH_CYCLES_PYTHON names no environment with bpy: {done.stderr.strip().splitlines()[-1:]}")
"""
FLIP = """
import flip_evaluator, numpy
black = numpy.zeros((16, 16, 3), numpy.float32)
assert flip_evaluator.evaluate(black, black + 1, "LDR")[1] > 0.5
"""
GIT = """
import subprocess, tempfile
with tempfile.TemporaryDirectory() as folder:
    subprocess.run(["git", "-C", folder, "init", "-q"], check=True)
"""
MEMORY = """
import sys, psutil
from engines.memory import limit_bytes
free = min(psutil.virtual_memory().available, limit_bytes())
if free < 3 << 30:
    sys.exit(f"{free / 2**30:.1f} GiB of memory are free, and 3 GiB are needed")
assert len(bytearray(2 << 30)) == 2 << 30
"""
UNPRIVILEGED = """
import os, sys
if os.geteuid() == 0:
    sys.exit("root may write anywhere")
"""
RUN_QUEUE = """
import sys
from harness.measure.run_queue import readable
if sys.platform != "linux" or not readable():
    sys.exit("the kernel does not count what threads wait")
"""
NVVM = """
import sys
from importlib.util import find_spec
if find_spec("nvidia") is None or find_spec("nvidia.cuda_nvcc") is None or find_spec("numba.cuda") is None:
    sys.exit("no nvidia-cuda-nvcc-cu12 is installed, or Numba has no numba.cuda")
"""
AVX2 = """
import sys
from engines.kernels.compile.processor import has_feature
if not has_feature("avx2"):
    sys.exit("the processor has no AVX2")
"""

NEEDS = {
    "mitsuba-llvm": MITSUBA.format(variant="LLVM"),
    "mitsuba-scalar": MITSUBA.format(variant="SCALAR"),
    "chromium": CHROMIUM,
    "luxcore": "import pyluxcore; pyluxcore.Init(); pyluxcore.Scene()",
    "cycles": CYCLES,
    "open3d": "import open3d; open3d.t.geometry.RaycastingScene()",
    "flip": FLIP,
    "ffmpeg": "import imageio_ffmpeg; imageio_ffmpeg.get_ffmpeg_version()",
    "git": GIT,
    "memory": MEMORY,
    "linux": "import sys; sys.exit(None if sys.platform == 'linux' else 'reads /proc')",
    "unprivileged": UNPRIVILEGED,
    "run-queue": RUN_QUEUE,
    "avx2": AVX2,
    "nvvm": NVVM,
}
FIXTURES = {"browser": "chromium"}
"""What tests need that ask for a fixture."""
ENGINES = {
    "mitsuba": "mitsuba-llvm",
    "mitsuba_scalar": "mitsuba-scalar",
    "luxcore": "luxcore",
    "cycles": "cycles",
    "open3d": "open3d",
}


def needs(*names: str) -> pytest.MarkDecorator:
    """The marker of a test that needs all these."""
    return pytest.mark.needs(*names)


def marks_of(engine: str) -> list[pytest.MarkDecorator]:
    """For `pytest.param`: what an engine of raybench needs."""
    return [needs(ENGINES[engine])] if engine in ENGINES else []


@cache
def lacking(name: str) -> str | None:
    """Why the machine lacks it, or None; asked once a session, in the folder that all of its processes know."""
    found = Path(os.environ[RESULTS], name)
    with open(found.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not found.exists():
            found.write_text(_ask(NEEDS[name]))
        return found.read_text() or None


def _ask(program: str) -> str:
    try:
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return f"using it takes longer than {SECONDS} s"
    if done.returncode < 0:
        return f"using it ends in {signal.Signals(-done.returncode).name}"
    said = done.stderr.strip().splitlines() or [f"using it ends with exit code {done.returncode}"]
    return said[-1] if done.returncode else ""


def required() -> frozenset[str]:
    """The names in `RAYBENCH_REQUIRE`. Raises `pytest.UsageError` for an unknown one."""
    names = frozenset(filter(None, map(str.strip, os.environ.get(REQUIRED, "").split(","))))
    for name in sorted(names - set(NEEDS)):
        raise pytest.UsageError(f"{REQUIRED}: {name!r} is unknown: expected some of {','.join(NEEDS)}")
    return names


class Plugin:
    """What conftest.py registers: the markers, the skips and the summary."""

    def pytest_configure(self, config):
        required()
        config.addinivalue_line("markers", "needs(*names): rows of tests/needs.py without which the test cannot run")
        for name in NEEDS:
            config.addinivalue_line("markers", f"{_marker(name)}: put on the tests that need {name}")

    def pytest_itemcollected(self, item):
        of_fixtures = [name for fixture, name in FIXTURES.items() if fixture in getattr(item, "fixturenames", ())]
        if of_fixtures:
            item.add_marker(needs(*of_fixtures))
        for name in self._of(item):
            item.add_marker(_marker(name))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item):
        for name in self._of(item):
            if reason := lacking(name):
                said = f"{PREFIX}{name}: {reason}"
                pytest.fail(said, pytrace=False) if name in required() else pytest.skip(said)

    def pytest_terminal_summary(self, terminalreporter):
        reasons = [str(report.longrepr[2]) for report in terminalreporter.stats.get("skipped", ()) if report.longrepr]
        counts = Counter(reason.removeprefix("Skipped: ") for reason in reasons if PREFIX in reason)
        if counts:
            terminalreporter.section(f"lacking here (with {REQUIRED}=NAME,... these tests fail instead)")
        for reason, count in sorted(counts.items()):
            terminalreporter.write_line(f"{count} skipped: {reason}")

    @staticmethod
    def _of(item) -> list[str]:
        names = dict.fromkeys(name for mark in item.iter_markers("needs") for name in mark.args)
        for name in names:
            if name not in NEEDS:
                raise pytest.UsageError(f"{item.nodeid}: needs {name!r}, which tests/needs.py does not know")
        return [*names]


def _marker(name: str) -> str:
    return name.replace("-", "_")
