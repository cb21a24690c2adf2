"""The server of a viewer, in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

PIXELS = """(() => { const c = document.getElementById('canvas');
  const copy = new OffscreenCanvas(c.width, c.height).getContext('2d', {willReadFrequently: true});
  copy.drawImage(c, 0, 0);
  const d = copy.getImageData(0, 0, c.width, c.height).data;
  let sum = 0; for (let i = 0; i < d.length; i++) sum = (sum * 31 + d[i]) % 1000003; return sum; })()"""
"""A hash of the pixels of the canvas."""
SCENE = """\
raybench_scene: 1
name: a ball and two lamps
camera: {type: perspective, eye: [0, 1, 5], target: [0, 1, 0], up: [0, 1, 0], fov: 40, resolution: [48, 36]}
materials:
  white: {kd: 0.7}
  red: {kd: [0.8, 0.1, 0.1]}
  lamp: {emission: [6, 6, 6]}
shapes:
  - {sphere: {center: [0, 0.8, 0], radius: 0.8}, material: red}
  - {plane: {point: [0, 0, 0], normal: [0, 1, 0]}, material: white}
  - {sphere: {center: [1.4, 2.2, 0], radius: 0.3}, material: lamp}
lights:
  - {point: {position: [-1.2, 2, 1], intensity: 4}}
"""
ROOT = Path(__file__).resolve().parents[2]


class Viewer:
    """`raybench view` on a folder. Use it as a context; `address` ends in a slash."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        command = [sys.executable, "-m", "harness", "view", *arguments, "--folder", str(folder), "--no-browser"]
        self._process = subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)}
        )
        line = self._process.stdout.readline()
        assert line.startswith("raybench view: http://127.0.0.1:"), line
        self.address = line.split()[2]
        self.pid = self._process.pid

    @property
    def port(self) -> int:
        return int(self.address.split(":")[2].split("/")[0])

    @property
    def token(self) -> str:
        return self.address.split("/")[3]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.terminate()
        try:
            self._process.wait(120)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise
