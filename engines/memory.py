"""What may be allocated: sizes that this machine cannot hold are refused before, not found out by being killed."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from engines.errors import ConfigError

WORTH_ASKING = 1 << 28
"""Bytes below which nothing is asked of the system."""


def machine_bytes() -> int:
    """The memory of this machine, or of its control group where that has less."""
    return min([_total(), *_control_group_limits()])


def _total() -> int:
    try:
        import psutil
    except ImportError:  # in the environment of an engine
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return psutil.virtual_memory().total


def limit_bytes() -> int:
    """What this process may have at most: the machine's memory, or its own limit (`ulimit -v`) where that is less."""
    own = _address_space()
    return machine_bytes() if own is None else min(machine_bytes(), own)


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


def lacking_memory(needed: float) -> str:
    """Empty where `needed` more bytes fit into the memory of this machine and of this process, else why they do not."""
    if needed < WORTH_ASKING and _address_space() is None:
        return ""
    total, has, own = machine_bytes(), "this machine has", _address_space()
    if own is not None:
        import psutil

        left = own - psutil.Process().memory_info().vms
        total, has = (left, "this process may take") if left < total else (total, has)
    return f"would need {_gibibytes(needed)}: {has} {_gibibytes(total)}" if needed > total else ""


def _address_space() -> int | None:
    """The limit of `ulimit -v`, None where there is none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft


def _control_group_limits(root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> list[int]:
    """The limits of this process's control group and of those above it (Linux, versions 1 and 2), in bytes."""
    found: list[int] = []
    with suppress(OSError, ValueError):
        for line in own.read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers and "memory" not in controllers.split(","):
                continue
            top, name = (root / "memory", "memory.limit_in_bytes") if controllers else (root, "memory.max")
            for folder in [top / path.lstrip("/"), *(top / path.lstrip("/")).parents]:
                if folder.is_relative_to(top):
                    with suppress(OSError, ValueError):
                        found.append(int((folder / name).read_text()))
    return found


def _gibibytes(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"
