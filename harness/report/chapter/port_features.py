"""What the port of Dahlquist's ray tracer can do, and what raybench's engines can: facts of their code.

Accelerators, and whether other scenes are rendered, are asked of the engines; what was raced, and how deep, of the results.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import engines
from engines.errors import RaybenchError
from harness.analysis import Analysis
from harness.config import paths
from harness.report.chapter.document import Section, TablePart
from harness.report.chapter.texts import listed
from harness.report.tables import Column, Table
from harness.store.results import BRUTE_FORCE, Results

PORT = "dahlquist"
ELSEWHERE = "two_spheres"
"""A small scene that is none of the port's."""
FACTS = (
    ("light", "a sun, without shadows", "emitting shapes, points, suns and skies, with shadows"),
    ("surfaces", "a colour and a whole mirror on top of it", "diffuse, mirrors, glass, metals, plastic, blends"),
    ("what is behind", "a picture fixed to the screen; mirrors show another", "one environment, seen and mirrored alike"),
    (
        "numbers",
        "float32 in a fixed order, squares added in float64; frames of 8 bits, clipped",
        "radiance in float32 or float64",
    ),
    ("threads", "any number in the port, eight in the original; the frame is the same", "any number; the image is the same"),
    (
        "progressive",
        "no: every frame is final; interlaced, a call draws every other row",
        "yes: samples add up, with checkpoints between",
    ),
    ("interactive", "balls are dragged", "shapes and camera move"),
    ("rays of one's own", "which ball a pixel shows", "closest hits and visibility of any rays"),
)
"""Feature, the port, raybench: what engines/dahlquist and the other engines are written to do."""


def section(analysis: Analysis) -> Section:
    table = Table(
        "port_features",
        "What each can do",
        "Accelerators are those that were raced, then in brackets any others.",
        [
            Column("feature", "Feature."),
            Column("port", "Dahlquist's ray tracer.", title="Dahlquist's ray tracer"),
            Column("raybench", "raybench's engines.", title="raybench"),
        ],
    )
    names = [e for e in analysis.results.engines if any(c.done for c in _of(analysis.results, e))]
    sides = [PORT] if PORT in names else [], [name for name in names if name != PORT]
    asked = {
        "scenes": [_elsewhere(side) for side in sides],
        "accelerators": ["; ".join(_accelerators(analysis.results, name) for name in side) for side in sides],
        "mirrors in mirrors": ["three balls along a path, then the probe" if sides[0] else "", _depth(analysis.results)],
    }
    table.rows += [{"feature": key, "port": port, "raybench": ours} for key, (port, ours) in asked.items()]
    table.rows += [{"feature": feature, "port": port, "raybench": ours} for feature, port, ours in FACTS]
    return Section("Features", [TablePart(table)])


def _of(results: Results, engine: str) -> list[Any]:
    return [c for c in results.contestants if c.settings.engine == engine and not c.settings.label]


def _elsewhere(names: Iterable[str]) -> str:
    """Whether engines render another scene, in their own words where they do not."""
    said = []
    scene = engines.load_scene(paths.find("scenes", ELSEWHERE))
    for name in names:
        try:
            reason = engines.engine(name).why_not(scene, engines.Settings())
        except RaybenchError as problem:
            reason = str(problem)
        said.append(reason or "any scene of raybench's format")
    return "; ".join(dict.fromkeys(said))


def _accelerators(results: Results, engine: str) -> str:
    """`numba: bvh and grid (none)`: those with a measurement, and those of the engine's others."""
    raced = list(dict.fromkeys(c.settings.accelerator.name for c in _of(results, engine) if c.done))
    try:
        others = [name for name in engines.engine(engine).accelerators() if name not in (*raced, "auto")]
    except RaybenchError:
        others = []
    return f"{engine}: {listed(_named(raced))}{f' ({listed(_named(others))})' if others else ''}"


def _named(accelerators: Iterable[str]) -> list[str]:
    return [BRUTE_FORCE if name == "none" else name for name in accelerators]


def _depth(results: Results) -> str:
    depths = {c.settings.shader.options.get("max_depth") for c in results.contestants if c.done and c.settings.engine != PORT}
    known = sorted(depth for depth in depths if isinstance(depth, int))
    return f"as many as max_depth allows, here {listed([str(depth) for depth in known])}" if known else ""
