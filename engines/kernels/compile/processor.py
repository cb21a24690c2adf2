"""The processor for which machine code is made."""

from __future__ import annotations

import llvmlite.binding


def has_feature(name: str) -> bool:
    """Whether the processor has a feature, by LLVM's name, such as avx512f."""
    return bool(llvmlite.binding.get_host_cpu_features().get(name))
