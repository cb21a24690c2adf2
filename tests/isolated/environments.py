"""Virtual environments without network or pip: this one's packages are seen from there, and a package `lantern` of a version is
installed there alone."""

from __future__ import annotations

import sys
import sysconfig
import venv
from pathlib import Path

MODULE = "lantern.py"


def environment(folder: Path, version: str, **constants: float) -> Path:
    """An environment in `folder` with that version of `lantern`, whose `constants` are numbers in capitals."""
    venv.create(folder, symlinks=True, with_pip=False)
    packages = folder / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
    (packages / "ours.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    values = {"RADIANCE": 1.0, "NOISE": 0.1, "SECONDS": 0.0, **constants}
    (packages / MODULE).write_text("".join(f"{name} = {value}\n" for name, value in values.items()))
    named = packages / f"lantern-{version}.dist-info"
    named.mkdir()
    (named / "METADATA").write_text(f"Metadata-Version: 2.1\nName: lantern\nVersion: {version}\n")
    (named / "RECORD").write_text(f"{MODULE},sha256={sorted(values.items())},1\n")
    return folder
