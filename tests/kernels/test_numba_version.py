"""A version of Numba that the kernels were not tested with is refused in one sentence; other engines work."""

import subprocess
import sys
import tomllib
from pathlib import Path

import numba
import pytest

from engines.errors import Unsupported
from engines.kernels import compile as compile_room

ROOT = Path(__file__).resolve().parents[2]
FIRST, LAST = (f"{major}.{minor}" for major, minor in (compile_room.OLDEST, compile_room.NEWEST))
BEYOND = f"{compile_room.NEWEST[0]}.{compile_room.NEWEST[1] + 1}"
PROGRAM = """
import numba
numba.__version__ = {version!r}
import engines
assert engines.engine("numpy").name == "numpy"
try:
    engines.engine({engine!r})
except engines.RaybenchError as error:
    print(error)
"""


@pytest.mark.parametrize("engine", ["numba", "embree"])
def test_an_engine_with_an_untested_numba_says_which_versions_are_wanted(engine):
    program = PROGRAM.format(version=f"{BEYOND}.1", engine=engine)
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert f"numba {BEYOND}.1 is installed" in done.stdout
    assert f"pip install 'numba>={FIRST},<{BEYOND}'" in done.stdout
    assert len(done.stdout.splitlines()) == 1


@pytest.mark.parametrize("version", [f"{BEYOND}.0", f"{BEYOND}.0rc1", "0.64.9", "1.0.0"])
def test_versions_outside_the_tested_ones_are_refused(monkeypatch, version):
    monkeypatch.setattr(numba, "__version__", version)
    with pytest.raises(Unsupported, match=f"numba {version} is installed"):
        compile_room._check_numba()


@pytest.mark.parametrize("version", [f"{FIRST}.0", f"{LAST}.1", f"{LAST}.0rc1"])
def test_tested_versions_are_taken(monkeypatch, version):
    monkeypatch.setattr(numba, "__version__", version)
    compile_room._check_numba()


def test_the_package_asks_for_the_tested_versions():
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert f"numba>={FIRST},<{BEYOND}" in wanted
