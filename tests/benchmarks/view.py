"""Latency of the viewer: `python tests/benchmarks/view.py [--engine NAME] [--scene NAME] [--size 512x512]`.

Speaks to a server as a page does, without a browser: from a request to the whole frame, on loopback. The first tab's figures
hold what starting costs; the others are of a worker that has rendered the scene before.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from tests.view.tab import Tab
from tests.view.viewer_process import Viewer

MOVES_A_SECOND = (10, 30)
SECONDS = 4.0


def frame(tab: Tab, preview: bool | None = None, seconds: float = 120.0):
    return tab.receive(lambda header: header["type"] == "frame" and preview in (None, header["preview"]), seconds)


def milliseconds(values: list[float]) -> str:
    ordered = sorted(values)
    return f"median {1e3 * statistics.median(ordered):.0f} ms, worst {1e3 * ordered[-1]:.0f} ms"


def first_frames(tab: Tab, request: dict, times: int) -> tuple[list[float], list[float]]:
    """Seconds to the first frame, and to the first at full resolution."""
    preview, full = [], []
    for _ in range(times):
        start = time.perf_counter()
        tab.send(**request)
        tab.receive(lambda header: header["type"] == "opened", 120)
        frame(tab)
        preview.append(time.perf_counter() - start)
        frame(tab, preview=False)
        full.append(time.perf_counter() - start)
        tab.send(type="stop")
        tab.state("stopped", "finished")
    return preview, full


def moves(tab: Tab, a_second: float) -> tuple[int, list[float]]:
    """How many camera moves were sent, and of each whose preview frame came, the seconds until then."""
    sent: dict[int, float] = {}
    waits: dict[int, float] = {}
    begin = time.perf_counter()
    while (now := time.perf_counter()) - begin < SECONDS:
        if now - begin >= len(sent) / a_second:
            angle = 0.02 * len(sent)
            eye = [3.9 * float(np.sin(angle)), 0.0, 3.9 * float(np.cos(angle))]
            sent[tab.send(type="camera", eye=eye, target=[0, 0, 0], up=[0, 1, 0])] = time.perf_counter()
        try:
            header = frame(tab, preview=True, seconds=max(0.001, begin + len(sent) / a_second - time.perf_counter()))
        except TimeoutError:
            continue
        if header["seq"] in sent:
            waits.setdefault(header["seq"], time.perf_counter() - sent[header["seq"]])
    return len(sent), list(waits.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", default="embree")
    parser.add_argument("--scene", default="cornell_box")
    parser.add_argument("--size", default="512x512")
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    settings = {
        "engine": given.engine,
        "shader": {"name": "path_tracer", "max_depth": 6},
        "sampler": {"name": "sobol"},
        "accelerator": {"name": "auto"},
        "threads": given.threads,
    }
    request = {"type": "open", "scene": given.scene, "settings": settings, "width": width, "height": height, "spp": 1 << 20}
    print(f"{given.scene} {given.size}, {given.engine}, {given.threads} threads")
    with tempfile.TemporaryDirectory() as folder, Viewer(Path(folder)) as viewer:
        start = time.perf_counter()
        with Tab(viewer) as tab:
            (preview,), (full,) = first_frames(tab, request, 1)
            total = time.perf_counter() - start
            print(f"a new tab: first frame after {preview:.2f} s, at full resolution after {full:.2f} s ({total:.2f} s in all)")
            coarse_warm, full_warm = first_frames(tab, request, 7)
            print(f"warm: first frame {milliseconds(coarse_warm)}; at full resolution {milliseconds(full_warm)}")
            for a_second in MOVES_A_SECOND:
                sent, waits = moves(tab, a_second)
                print(f"{a_second} moves/s: {sent} sent, {len(waits)} seen, each after {milliseconds(waits)}")
            tab.send(**request)
            tab.receive(lambda header: header["type"] == "opened")
            frame(tab, preview=False)
            begin, count = time.perf_counter(), 0
            while time.perf_counter() - begin < SECONDS:
                frame(tab)
                count += 1
            print(f"while it renders: {count / (time.perf_counter() - begin):.1f} frames/s")
            pings = []
            for _ in range(50):
                start = time.perf_counter()
                tab.socket.ping().wait(5)
                pings.append(time.perf_counter() - start)
                time.sleep(0.02)
            print(f"a ping while it renders: {milliseconds(pings)}")
            start = time.perf_counter()
            tab.send(type="stop")
            tab.state("stopped")
            print(f"a stop: {1e3 * (time.perf_counter() - start):.0f} ms")


if __name__ == "__main__":
    main()
