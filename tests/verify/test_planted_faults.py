"""Every planted fault is caught by the case that is there for it; without it the case is kept.

The sources of the reference, or of the jitted engine, are copied and changed by text (`mutated.FAULTS`), and the copy is
examined as an engine of its own: what the battery finds, it finds through the interface.
"""

import os
import warnings

import pytest
from mutated import FAULTS, mutated

import engines
from harness.verify.battery import BROKEN, CASES, KEPT, examined
from harness.verify.subject import Subject

BY_ID = {case.id: case for case in CASES}


def _verdicts(engine, fault):
    """As they are found: a fault is caught by the first that is broken."""
    subject = Subject(engine, "float64", fault.accelerator)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield from (finding.verdict for finding in examined(BY_ID[fault.case], subject))


DEAR = pytest.mark.skipif(
    "RAYBENCH_ALL_FAULTS" not in os.environ, reason="compiles for half a minute: RAYBENCH_ALL_FAULTS=1"
)
ASKED = {(fault.jitted, fault.case, fault.accelerator): fault for fault in FAULTS}


def _each(faults, name):
    """Of the faults in the jitted engine only those in spheres by default: a changed copy of it is compiled anew."""
    return [pytest.param(fault, id=name(fault), marks=[DEAR] if fault.jitted and fault.case != "S1" else [])
            for fault in faults]  # fmt: skip


@pytest.mark.parametrize("fault", _each(FAULTS, lambda fault: fault.name))
def test_a_planted_fault_is_caught(fault, tmp_path):
    assert BROKEN in _verdicts(mutated(fault, tmp_path), fault)


@pytest.mark.parametrize(
    "fault", _each(ASKED.values(), lambda fault: f"{fault.case} {fault.accelerator} {fault.jitted}")
)
def test_the_same_case_is_kept_without_it(fault):
    assert set(_verdicts(engines.engine("numba" if fault.jitted else "numpy"), fault)) == {KEPT}
