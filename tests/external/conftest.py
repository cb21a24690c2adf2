"""The helpers beside the tests, and those of the harness's tests, can be imported, here and in worker processes."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
for folder in (str(HERE), str(HERE.parent / "harness")):
    if folder not in sys.path:
        sys.path.insert(0, folder)
    if folder not in os.environ.get("PYTHONPATH", "").split(os.pathsep):
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [folder, os.environ.get("PYTHONPATH", "")]))
