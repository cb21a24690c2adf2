"""Conclusions from results: `analyse` gives every contestant's verdict, computed once for tables, plots and the report."""

from harness.analysis.model import Analysis, Verdict, seconds_per_sample
from harness.analysis.verdicts import analyse, baseline_engine_of, error_targets, reports_its_time
