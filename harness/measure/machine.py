"""What the measurements were made on: processor, cores, libraries, and the state of the checkout."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil

LIBRARIES = ("numpy", "numba", "llvmlite", "embreex", "mitsuba", "scipy", "scikit-image")
SOURCES = ("engines/__init__.py", "harness/measure/machine.py")


def environment() -> dict[str, Any]:
    """The preimage of `env_id`: what may change a speed or a bit without the experiment changing."""
    return {
        "cpu": cpu_model(),
        "physical_cores": psutil.cpu_count(logical=False),
        "logical_cores": psutil.cpu_count(),
        "usable_cores": len(usable_cores()),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "system": platform.system(),
        "kernel": platform.release(),
        "architecture": platform.machine(),
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "libraries": {name: found for name in LIBRARIES if (found := _installed(name))},
    }


def provenance() -> dict[str, Any]:
    """`environment` with what identifies the moment: commit, governor, load. No names: results may be published."""
    return {
        **environment(),
        "raybench": _installed("raybench"),
        "scaling_governor": _first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        "load_1m": round(load_1m(), 2),
        "git": git_state(Path(__file__).resolve().parents[2]),
    }


def cpu_model() -> str:
    """The processor's own name, without any package that asks slowly for it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.lower().startswith(("model name", "hardware", "cpu model")):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine() or "unknown"


def usable_cores() -> list[int]:
    """Indices of the cores this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def load_1m() -> float:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def git_state(folder: Path) -> dict[str, Any] | None:
    """Commit and dirty flag of the checkout whose sources raybench's are, in `folder`; None where git tracks none of them.

    An installed package may lie inside a repository that is somebody else's.
    """
    if _git(folder, "ls-files", "--error-unmatch", "--", *SOURCES) is None:
        return None
    commit = _git(folder, "rev-parse", "HEAD")
    if not commit:
        return None
    changes = _git(folder, "status", "--porcelain", "--untracked-files=no", "--", ".")
    return {"commit": commit, "dirty": bool(changes)}


def project_state(folder: Path) -> dict[str, Any] | None:
    """Commit and dirty flag of the checkout that `folder` lies in: of an experiment's, that of the renderer beside it. None
    where it lies in none."""
    commit = _git(folder, "rev-parse", "HEAD")
    return {"commit": commit, "dirty": bool(_git(folder, "status", "--porcelain", "--untracked-files=no"))} if commit else None


def _git(folder: Path, *arguments: str) -> str | None:
    # Inside a hook of git these variables name the repository that the hook is of.
    own = {key: value for key, value in os.environ.items() if key not in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE")}
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=False, env=own
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _first_line(path: str) -> str | None:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return None
