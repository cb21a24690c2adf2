"""Draws the parts, a ray's way and a cell's way for docs/how/: python docs/pictures/drawings.py

SVG on a ground of its own, so that it reads on light and dark pages.
"""

from collections.abc import Sequence
from html import escape
from pathlib import Path

TARGET = Path(__file__).resolve().parent / "drawings"
INK, SOFT, LINE, GROUND = "#1f2430", "#5b6472", "#7a8494", "#ffffff"
BLUE, GREEN, AMBER, GREY = "#dce9f7", "#dff1e3", "#fbeed2", "#eef0f3"
FONT = "font-family='DejaVu Sans, Verdana, sans-serif'"


class Drawing:
    """Boxes and arrows, in pixels from the top left."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self.size, self.title, self.parts = (width, height), title, []

    def box(self, x: int, y: int, w: int, h: int, title: str, lines: Sequence[str] = (), fill: str = GREY) -> None:
        self.parts.append(f"<rect x='{x}' y='{y}' width='{w}' height='{h}' rx='6' fill='{fill}' stroke='{LINE}'/>")
        first = y + h / 2 - 7.5 * len(lines) + 5
        self.text(x + w / 2, first, title, bold=True, size=13 if 8.4 * len(title) < w else 11 if 7.4 * len(title) < w else 10)
        for k, line in enumerate(lines, 1):
            self.text(x + w / 2, first + 15 * k, line, soft=True)

    def text(
        self, x: float, y: float, words: str, bold: bool = False, soft: bool = False, at: str = "middle", size: int = 13
    ) -> None:
        weight = " font-weight='bold'" if bold else ""
        size, colour = (11, SOFT) if soft else (size, INK)
        self.parts.append(
            f"<text x='{x:g}' y='{y:g}' font-size='{size}' fill='{colour}' text-anchor='{at}'{weight}>{escape(words)}</text>"
        )

    def arrow(self, *points: tuple[float, float], dashed: bool = False) -> None:
        path = " ".join(f"{x:g},{y:g}" for x, y in points)
        dash = " stroke-dasharray='5 4'" if dashed else ""
        self.parts.append(
            f"<polyline points='{path}' fill='none' stroke='{LINE}' stroke-width='1.5'{dash} marker-end='url(#tip)'/>"
        )

    def save(self, name: str) -> None:
        width, height = self.size
        tip = f"<path d='M0,0 L8,4 L0,8 z' fill='{LINE}'/>"
        body = "\n".join(self.parts)
        (TARGET / f"{name}.svg").write_text(
            f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' height='{height}' "
            f"role='img' {FONT}>\n<title>{escape(self.title)}</title>\n"
            "<defs><marker id='tip' viewBox='0 0 8 8' refX='7' refY='4' markerWidth='8' markerHeight='8' orient='auto'>"
            f"{tip}</marker></defs>\n<rect width='{width}' height='{height}' rx='8' fill='{GROUND}'/>\n{body}\n</svg>\n",
            encoding="utf-8",
        )


def house() -> None:
    d = Drawing(780, 670, "The parts: the harness, the public interface, the engines, the kernels and the scene")
    d.text(20, 30, "harness/", bold=True, at="start")
    d.text(20, 47, "imports public names of engines alone; each part imports from those to its right", soft=True, at="start")
    rooms = [
        ("commands", ["cli/, console,", "view/"]),
        ("output", ["report/: tables,", "plots, chapter"]),
        ("runs", ["run/: sweep,", "recorder, executors"]),
        ("verdicts and plans", ["analysis/,", "plan/"]),
        ("foundation", ["store/, measure/,", "config/, verify/,", "statistics/"]),
    ]
    for k, (title, lines) in enumerate(rooms):
        d.box(20 + 150 * k, 60, 140, 70, title, lines, BLUE)
    d.arrow((390, 130), (390, 166))
    d.box(
        20,
        168,
        740,
        62,
        "engines: the public interface",
        [
            "interface: Engine, Renderer, Settings, Hits  |  registry: from a name to an engine",
            "plugin: shaders, samplers, lights, BSDFs, cameras of yours  |  conformance: tests of every engine",
        ],
        AMBER,
    )
    d.arrow((390, 230), (390, 262), dashed=True)
    d.text(398, 251, "imported by name, when wanted", soft=True, at="start")
    engines = [
        ("numba", ["list, grid,", "tree"]),
        ("embree", ["Intel's", "Embree"]),
        ("numpy", ["the reference"]),
        ("embreex_batch", ["shades as", "numpy does"]),
        ("mitsuba", ["Mitsuba 3"]),
        ("external", ["any program"]),
        ("yours", ["two classes"]),
    ]
    for k, (title, lines) in enumerate(engines):
        d.box(20 + 107 * k, 264, 98, 66, title, lines, GREEN if title != "yours" else AMBER)
    d.arrow((341, 297), (332, 297))
    d.arrow((69, 330), (69, 362))
    d.arrow((176, 330), (176, 362))
    d.parts.append(f"<rect x='20' y='364' width='212' height='218' rx='6' fill='{GREY}' stroke='{LINE}'/>")
    d.text(126, 381, "engines/kernels", bold=True)
    floors = [
        ("renderer, driver, queries", AMBER),
        ("stages: loops over lanes", GREEN),
        ("integrators  |  flatten", GREEN),
        ("lane: shapes, lights, BSDFs", GREEN),
        ("layout, features", BLUE),
        ("compile: Numba and LLVM", BLUE),
    ]
    for k, (words, fill) in enumerate(floors):
        d.parts.append(f"<rect x='30' y='{390 + 31 * k}' width='192' height='26' rx='4' fill='{fill}' stroke='{LINE}'/>")
        d.text(126, 407 + 31 * k, words, size=11)
    for x in (283, 390, 497, 604, 711):
        d.arrow((x, 330), (x, 602))
    d.arrow((126, 582), (126, 602))
    d.box(
        20,
        604,
        740,
        50,
        "engines/scene, film, errors",
        ["scene files and models, sums of samples, messages: they know no engine"],
        GREY,
    )
    d.save("house")


def ray() -> None:
    d = Drawing(910, 390, "A ray's way through a batch of sixteen lanes")
    top = [
        ("draw", ["two numbers", "for the pixel"], AMBER),
        ("begin", ["the camera's", "ray"], AMBER),
        ("closest", ["distance and", "primitive"], BLUE),
        ("surface", ["point, normal,", "material"], GREEN),
        ("draw", ["numbers of", "the vertex"], AMBER),
        ("material", ["wrappers and", "textures"], GREEN),
    ]
    bottom = [
        ("finish", ["end, or the", "next segment"], GREEN),
        ("occluded", ["is the light", "visible?"], BLUE),
        ("shade", ["the integrator's", "step"], AMBER),
        ("BSDF", ["value, pdf,", "sample"], GREEN),
        ("light", ["one sample", "of a light"], GREEN),
    ]
    for k, (title, lines, fill) in enumerate(top):
        d.box(20 + 150 * k, 50, 120, 68, title, lines, fill)
        if k:
            d.arrow((20 + 150 * k - 30, 84), (20 + 150 * k, 84))
    for k, (title, lines, fill) in enumerate(bottom):
        d.box(20 + 150 * k, 190, 120, 68, title, lines, fill)
        if k:
            d.arrow((20 + 150 * k, 224), (20 + 150 * k - 30, 224))
    d.arrow((830, 118), (830, 224), (742, 224))
    d.arrow((110, 190), (110, 154), (380, 154), (380, 120))
    d.text(245, 148, "alive: the next segment", soft=True)
    d.arrow((50, 190), (50, 120))
    d.text(56, 148, "free:", soft=True, at="start")
    d.text(56, 162, "next", soft=True, at="start")
    d.text(56, 176, "sample", soft=True, at="start")
    d.text(20, 30, "One batch: sixteen paths, each stage for all of them", bold=True, at="start")
    d.arrow((80, 258), (80, 300))
    d.box(20, 302, 120, 58, "film", ["sums per pixel"], GREY)
    for k, (fill, words) in enumerate(
        [
            (BLUE, "differs between engines: numba's list, grid and tree; Embree; an accelerator of yours"),
            (AMBER, "replaced by a plugin: sampler (draw), camera (begin), shader (shade)"),
            (GREEN, "the same for all jitted engines; plugins add lights and BSDFs"),
        ]
    ):
        d.parts.append(f"<rect x='180' y='{302 + 21 * k}' width='14' height='14' fill='{fill}' stroke='{LINE}'/>")
        d.text(202, 314 + 21 * k, words, soft=True, at="start")
    d.save("ray")


def cell() -> None:
    d = Drawing(780, 560, "A cell's way through the harness")
    for x, title, words in (
        (20, "command", "never renders"),
        (275, "worker", "one per engine and block"),
        (530, "child", "one per cell, forked"),
    ):
        d.text(x + 115, 26, title, bold=True)
        d.text(x + 115, 42, words, soft=True)
        d.parts.append(f"<line x1='{x + 115}' y1='50' x2='{x + 115}' y2='545' stroke='{LINE}' stroke-dasharray='2 5'/>")
    steps = [
        (20, 56, 44, "the next cell", ["of a block, in random order"], BLUE),
        (275, 56, 44, "imports the engine", [], GREEN),
        (530, 108, 44, "loads the scene", [], GREEN),
        (
            530,
            172,
            60,
            "prepares, compiles, renders 1 spp",
            ["at another seed, then drops it:", "what a cold start costs"],
            GREEN,
        ),
        (530, 252, 44, "prepares the cell's own seed", ["off the clock"], GREEN),
        (530, 316, 48, "render to the next checkpoint", ["on the clock: nothing but this"], AMBER),
        (20, 372, 60, "error, image, progress", ["against the reference;", "nothing renders meanwhile"], BLUE),
        (20, 488, 52, "appends the event", ["written and synced"], BLUE),
    ]
    for x, y, h, title, lines, fill in steps:
        d.box(x, y, 230, h, title, lines, fill)
    d.arrow((250, 78), (274, 78))
    d.arrow((505, 78), (645, 78), (645, 106))
    d.text(575, 72, "fork", soft=True)
    for y0, y1 in ((152, 170), (232, 250), (296, 314)):
        d.arrow((645, y0), (645, y1))
    d.arrow((645, 364), (645, 390), (252, 390))
    d.text(440, 384, "the film's arrays, in a file", soft=True)
    d.arrow((250, 420), (720, 420), (720, 366))
    d.text(440, 438, "go on, until the time, the samples or the checkpoints are spent", soft=True)
    d.arrow((135, 432), (135, 486))
    d.text(145, 464, "after the last checkpoint", soft=True, at="start")
    d.save("cell")


if __name__ == "__main__":
    TARGET.mkdir(exist_ok=True)
    house()
    ray()
    cell()
