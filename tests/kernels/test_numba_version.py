"""A version of Numba that the kernels were not tested with is refused in one sentence; other engines work."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numba
import pytest

from engines.errors import Unsupported
from engines.kernels import compile as compile_room

COMPILE = Path(compile_room.__file__).parent
PRIVATE_NAME = re.compile(r"(?<!self)(?<!cls)\._[a-z]\w*")
OURS_OR_OBJECTS = {
    *("_fields", "_replace", "_exit"),  # of NamedTuples and `os`
    "_cache",  # of a dispatcher, and of a C function: where its machine code is kept
    "_tm",  # of a code generator: the target machine, for the passes over functions
    "_finalized",  # of a library: its making has ended
    "_defn",  # of an intrinsic: its Python function, a part of the key of machine code
}
"""Private names that are not parts of Numba's classes: of its objects, or not of Numba."""
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


@pytest.mark.parametrize("place", compile_room.PRIVATE)
def test_what_is_used_of_numbas_private_parts_is_there(place):
    module, _, names = place.partition(":")
    found = importlib.import_module(module)
    for name in names.split("."):
        assert hasattr(found, name), f"numba {numba.__version__} has no {place}: {compile_room.PRIVATE[place]}"
        found = getattr(found, name)


def test_every_private_name_of_numba_in_the_sources_is_listed():
    used = {name[1:] for path in COMPILE.glob("*.py") for name in PRIVATE_NAME.findall(path.read_text())}
    listed = {place.rpartition(".")[2].rpartition(":")[2] for place in compile_room.PRIVATE}
    assert {name for name in used if not name.startswith("__")} - OURS_OR_OBJECTS <= listed
