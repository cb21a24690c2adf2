"""The processor for which machine code is made."""

from __future__ import annotations

import llvmlite.binding
from numba import config


def has_feature(name: str) -> bool:
    """Whether the processor has a feature, by LLVM's name, such as avx512f."""
    if config.CPU_FEATURES is not None:
        return f"+{name}" in config.CPU_FEATURES.split(",")
    return bool(llvmlite.binding.get_host_cpu_features().get(name))
