"""Takes the pictures of the viewer in docs/view.md: python docs/pictures/view.py [NAME ...]

Needs Chromium and the extra `view`. Names: view, dark, narrow, race, dahlquist.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.browser import Browser  # noqa: E402
from tests.view.viewer_process import Viewer  # noqa: E402

TARGET = Path(__file__).resolve().parent / "view"
READY = "window.raybench && (raybench.settingsForm || raybench.settingsForms || raybench.menu)"


def rendered(page: Browser, scene: str, size: tuple[int, int], spp: int) -> None:
    for key, value in {"scene": scene, "width": size[0], "height": size[1], "target-spp": spp}.items():
        page.set(f"#{key}", value)
    page.wait_for(f"raybench.state === 'finished' && raybench.status.spp === {spp} && !raybench.frame.preview")


def view(page: Browser, address: str) -> None:
    page.open(address, 1280, 900)
    page.wait_for(READY)
    rendered(page, "two_spheres", (400, 300), 96)
    page.press("h")
    page.point(*page.spot(0.4, 0.6))
    page.wait_for("raybench.probe")


def dark(page: Browser, address: str) -> None:
    page.open(address, 1280, 960, dark=True)
    page.wait_for(READY)
    rendered(page, "cornell_box", (320, 320), 96)


def narrow(page: Browser, address: str) -> None:
    page.open(address, 360, 760)
    page.wait_for(READY)
    rendered(page, "mobilert_spheres2", (256, 256), 96)


def race(page: Browser, address: str) -> None:
    page.open(address + "race.html", 1280, 1450)
    page.wait_for("window.raybench && raybench.settingsForms.length === 2")
    page.click("#add")
    for key, value in {
        "scene": "cornell_box",
        "width": 256,
        "height": 256,
        "targets": "0.1 0.01",
        "reference-spp": 512,
        "max-seconds": 3,
    }.items():
        page.set(f"#{key}", value)
    page.click("#start")
    page.wait_for("raybench.state === 'finished'")


def dahlquist(page: Browser, address: str) -> None:
    page.open(address + "dahlquist.html", 1280, 1060)
    page.wait_for("window.raybench && raybench.menu")
    page.wait_for("raybench.status && raybench.status.frames_per_second && raybench.frames > 100")


SHOTS: dict[str, Callable[[Browser, str], None]] = {
    "view": view,
    "dark": dark,
    "narrow": narrow,
    "race": race,
    "dahlquist": dahlquist,
}


def main(names: list[str]) -> None:
    TARGET.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, Viewer(Path(folder)) as viewer, Browser() as page:
        for name in names or SHOTS:
            SHOTS[name](page, viewer.address)
            page.evaluate("new Promise(done => setTimeout(done, 400))")
            page.evaluate("scrollTo(0, 0)")
            page.picture(TARGET / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
