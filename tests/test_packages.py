"""Commands that install what is missing: of a checkout, and of an installed wheel."""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from engines import packages

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_an_extra_is_that_of_the_checkout_named_from_where_one_stands(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", str(ROOT / ".venv" / "bin" / "python"))
    monkeypatch.chdir(ROOT)
    assert packages.install_extra("flip") == ".venv/bin/python -m pip install -e '.[flip]'"
    monkeypatch.chdir(tmp_path)
    assert packages.install_extra("flip") == f"{ROOT}/.venv/bin/python -m pip install -e '{ROOT}[flip]'"


def test_an_extra_of_an_installed_raybench_is_its_packages(monkeypatch, tmp_path):
    """raybench itself is in no package index."""
    monkeypatch.setattr(packages, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "executable", "/env with space/bin/python")
    required = [
        "numpy>=2.0",
        "flip-evaluator>=1.6; extra == 'flip'",
        "one<2,>=1; python_version > '3' and extra == 'pair'",
        "other; extra == 'pair'",
        "none; python_version < '3' and extra == 'pair'",
    ]
    monkeypatch.setattr(metadata, "requires", lambda name: required)
    assert packages.install_extra("flip") == "'/env with space/bin/python' -m pip install 'flip-evaluator>=1.6'"
    assert packages.install_extra("pair") == "'/env with space/bin/python' -m pip install 'one<2,>=1' other"


def test_every_extra_that_a_message_names_exists():
    sources = [path.read_text() for folder in ("engines", "harness") for path in (ROOT / folder).rglob("*.py")]
    named = {name for source in sources for name in re.findall(r"""install_extra\(["'](\w+)["']\)""", source)}
    assert {"mitsuba", "luxcore", "view"} <= named <= set(EXTRAS)
    assert not any("pip install" in source for source in sources if "-m pip install" not in source)


@pytest.mark.parametrize("name", sorted(EXTRAS))
def test_every_extra_is_known_by_its_packages(name, monkeypatch, tmp_path):
    monkeypatch.setattr(packages, "ROOT", tmp_path)
    assert packages.install_extra(name).split(" install ")[1]
