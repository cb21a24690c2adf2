"""The accuracy suite of `raybench verify`: hard cases and known answers, for any engine, through its public interface.

    from harness.verify import run_suite
    for result in run_suite([my_engine], quick=True):
        print(result.case, result.parameter, result.error, result.outcome)

A case (`case`) has a description, a source and a function of a `Subject` (`subject`) that yields measurements. `suite` runs
the cases, compares each measurement with a tolerance (`tolerances`) and gives a `CheckResult`. Exact answers come from
`oracle` and `closed_forms`. The cases are in `checks/`, the commands in `commands/`.
"""

from harness.check_results import CheckResult
from harness.verify.results_file import read_results
from harness.verify.suite import CASES, run_suite
