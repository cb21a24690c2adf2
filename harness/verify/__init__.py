"""`raybench verify`: a battery of hard cases and known answers against any engine, through the interface alone.

    from harness.verify import findings
    for finding in findings([my_engine], quick=True):
        print(finding.case, finding.parameter, finding.error, finding.verdict)

A case is a sentence, a source and a function of a `Subject` that yields what it measured (`case.py`); what an engine
promises, by the precision in which it traces, stands in one table (`promises.py`); exact answers come from `oracle.py`.
"""

from harness.verify.battery import CASES, Finding, findings

__all__ = ["CASES", "Finding", "findings"]
