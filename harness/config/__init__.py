"""Experiment files: `load` reads one; the other modules hold its settings, matrix, filters, schema and search paths."""

from harness.config.experiment import (
    SCHEMA_VERSION,
    Checkpoints,
    Experiment,
    Limits,
    Quality,
    ReferenceConfig,
    VerifyConfig,
    load,
    override,
    parse,
    read_quality,
)
from harness.config.settings import Budget

__all__ = [
    "SCHEMA_VERSION", "Budget", "Checkpoints", "Experiment", "Limits", "Quality", "ReferenceConfig", "VerifyConfig", "load",
    "override", "parse", "read_quality",
]  # fmt: skip
