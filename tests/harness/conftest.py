"""Helpers beside the tests can be imported, here and in the worker processes that tests start; one report for all."""

import os
import sys
from pathlib import Path

import pytest

HERE = str(Path(__file__).resolve().parent)
if HERE not in sys.path:
    sys.path.insert(0, HERE)
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [HERE, os.environ.get("PYTHONPATH", "")]))


@pytest.fixture(scope="session")
def reported(tmp_path_factory):
    """The synthetic folder with tables, plots and report: derived once for all workers. To be read, not changed."""
    from tests.harness import once, synthetic

    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("RAYBENCH_PLOTS", "svg")
        return once.built(tmp_path_factory, "reported", synthetic.write_reported)
