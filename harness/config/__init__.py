"""Experiment files: `load` reads one. One description of its keys (`experiment.KEYS`) makes reader, schema and reference."""

from harness.config.experiment import SCHEMA_VERSION, Experiment, experiment_schema, load, override, parse, read_quality
from harness.config.sections import Checkpoints, Limits, Quality, ReferenceConfig, VerifyConfig
from harness.config.settings import Budget

__all__ = [
    "SCHEMA_VERSION",
    "Budget",
    "Checkpoints",
    "Experiment",
    "Limits",
    "Quality",
    "ReferenceConfig",
    "VerifyConfig",
    "experiment_schema",
    "load",
    "override",
    "parse",
    "read_quality",
]
