"""Writes a renderer's file for `a_renderer.py`."""

import sys
from pathlib import Path

import yaml

HERE = Path(__file__).resolve().parent


def described(folder, mode="well", **changes):
    """The path of a file; a key that is changed to None is left out."""
    words = [sys.executable, str(HERE / "a_renderer.py"), mode, "{spp}", "{seed}", "{width}", "{height}", "{image}"]
    said = {
        "raybench_renderer": 1,
        "name": f"a_renderer_{mode}",
        "version": "1",
        "command": words,
        "image": "pfm",
        "shaders": ["path_tracer", "albedo"],
        "environment": {"A_SCENE": "{scene}", "T": "{threads}"},
        **changes,
    }
    path = folder / f"{mode}.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in said.items() if value is not None}))
    return path
