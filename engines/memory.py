"""What may be allocated: sizes that this machine cannot hold are refused before, not found out by being killed."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from engines.errors import ConfigError

WORTH_ASKING = 1 << 28
"""Bytes below which nothing is asked of the system."""
_CONTROL_GROUP = Path("/sys/fs/cgroup/memory.max")


def limit_bytes() -> int:
    """What this process may have at most: the machine's memory, or its control group's or its own limit if that is less."""
    import psutil

    limits = [psutil.virtual_memory().total]
    with suppress(OSError, ValueError):  # no such file, or "max"
        limits.append(int(_CONTROL_GROUP.read_text()))
    with suppress(ImportError):  # Windows
        import resource

        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        limits += [own] if own != resource.RLIM_INFINITY else []
    return min(limits)


def require(needed: int, what: str) -> None:
    """Raises `ConfigError` if `what`, which takes `needed` bytes, is more than this process may have."""
    if needed < WORTH_ASKING:
        return
    limit = limit_bytes()
    if needed > limit:
        raise ConfigError(
            f"{what}: takes {needed} bytes of memory ({needed / 2**30:.4g} GiB), and {limit} ({limit / 2**30:.4g} GiB) "
            "are the limit here: choose a smaller size"
        )
