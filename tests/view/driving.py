"""A viewer's server in a process of its own, and the browser that looks at it."""

import os
import subprocess
import sys
import time
from pathlib import Path

from tests.harness.chromium import Browser

PIXELS = """(() => { const c = document.getElementById('canvas');
  const copy = new OffscreenCanvas(c.width, c.height).getContext('2d', {willReadFrequently: true});
  copy.drawImage(c, 0, 0);
  const d = copy.getImageData(0, 0, c.width, c.height).data;
  let sum = 0; for (let i = 0; i < d.length; i++) sum = (sum * 31 + d[i]) % 1000003; return sum; })()"""
"""A number that tells pictures apart."""
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
        self._process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True,
                                         env={**os.environ, "PYTHONPATH": str(ROOT)})  # fmt: skip
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
            self._process.wait(15)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise


class Page(Browser):
    """The browser, online, with what the viewer's pages are asked and told."""

    def __enter__(self):
        super().__enter__()
        self.ask("Network.emulateNetworkConditions", offline=False, latency=0, downloadThroughput=-1, uploadThroughput=-1)
        self.ask("Browser.setDownloadBehavior", behavior="deny")
        return self

    def window(self, width, height, dark):
        """Gives the window a size and the theme that pages are asked for."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])

    def visit(self, address, width=1280, height=900, dark=False):
        """Loads a page and waits for it."""
        self.window(width, height, dark)
        self.events.clear()
        self.ask("Page.navigate", url=address)
        while "Page.loadEventFired" not in self.events:
            self._note(self._receive(30))

    def named_key(self, key, shift=False):
        """A key without a character, as `ArrowLeft`."""
        for kind in ("rawKeyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, modifiers=8 if shift else 0)

    def drag(self, start, end, steps=8, pause=0.02):
        """A drag with the left button, in pixels of the window."""
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        for step in range(1, steps + 1):
            x, y = (a + (b - a) * step / steps for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, button="left", buttons=1)
            time.sleep(pause)
        self.mouse("mouseReleased", *end, button="left", buttons=0, clickCount=1)

    def spot(self, x, y):
        """Where a place of the image, in shares of its size, is in the window."""
        box = self.evaluate("""(() => { const c = document.getElementById('canvas'); c.scrollIntoView({block: 'nearest'});
            const r = c.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()""")
        return box[0] + x * box[2], box[1] + y * box[3]

    def set(self, selector, value):
        """Gives a control a value, as somebody at the page would."""
        self.evaluate(f"""(() => {{ const e = document.querySelector({selector!r});
            if (e.type === 'checkbox') e.checked = {str(bool(value)).lower()}; else e.value = {str(value)!r};
            e.dispatchEvent(new Event('input', {{bubbles: true}}));
            e.dispatchEvent(new Event('change', {{bubbles: true}})); }})()""")

    def click(self, selector):
        self.evaluate(f"document.querySelector({selector!r}).click()")
