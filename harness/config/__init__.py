"""Experiment files: `load` reads one. One description of its keys (`experiment.KEYS`) makes reader, schema, reference and the
normalised file."""

from harness.config.experiment import (
    SCHEMA_VERSION,
    Checkpoints,
    Experiment,
    Limits,
    Quality,
    ReferenceConfig,
    VerifyConfig,
    experiment_schema,
    load,
    parse,
    read_quality,
    recorded,
)
from harness.config.files import ConfigFile, override, read_file
from harness.config.kinds import RECORDED
from harness.config.settings import Budget
