"""Every planted fault is caught by the case that is meant for it; without the fault the case passes.

The sources of the reference, or of the jitted engine, are copied and changed by text (`mutated.FAULTS`). The suite checks the
copy as an engine of its own, through the interface alone.
"""

import warnings

import pytest

import engines
from harness.check_results import FAIL, PASS
from harness.verify.subject import Subject
from harness.verify.suite import CASES, run_case
from tests.verify.mutated import FAULTS, mutated, source_of

BY_ID = {case.id: case for case in CASES}


def _outcomes(engine, fault):
    """One by one: the first failure catches a fault."""
    subject = Subject(engine, "float64", fault.accelerator)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield from (result.outcome for result in run_case(BY_ID[fault.case], subject))


CHECKS = {(fault.jitted, fault.case, fault.accelerator): fault for fault in FAULTS}


def _each(faults, name):
    """By default only the sphere faults of the jitted engine run: every changed copy of it is compiled anew, half a minute."""
    return [
        pytest.param(fault, id=name(fault), marks=[pytest.mark.slow] if fault.jitted and fault.case != "S1" else [])
        for fault in faults
    ]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_sources_hold_what_a_fault_changes(fault):
    source = source_of(fault).read_text()
    assert fault.before in source and fault.also[0] in source


@pytest.mark.parametrize("fault", _each(FAULTS, lambda fault: fault.name))
def test_a_planted_fault_is_caught(fault, tmp_path):
    assert FAIL in _outcomes(mutated(fault, tmp_path), fault)


@pytest.mark.parametrize("fault", _each(CHECKS.values(), lambda fault: f"{fault.case} {fault.accelerator} {fault.jitted}"))
def test_the_case_passes_without_the_fault(fault):
    assert set(_outcomes(engines.engine("numba" if fault.jitted else "numpy"), fault)) == {PASS}
