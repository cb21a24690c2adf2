"""Draws the pieces of docs/guides/scene.md and materials.md: python docs/pictures/pieces.py [NAME ...]

A picture shows the YAML block below it: a whole scene as it is, a piece with a floor, an environment and an area light. A piece
without shapes gets a ball.
"""

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

import engines

PICTURES = Path(__file__).resolve().parent / "pieces"
PAGES = [PICTURES.parents[1] / "guides" / name for name in ("scene.md", "materials.md")]
BLOCK = re.compile(r"pieces/(\w+)\.png\)\n\n```yaml scene\n(.*?)```", re.DOTALL)
WHOLE = re.compile(r"```yaml (\w+)\.yaml\n(raybench_scene.*?)```", re.DOTALL)
SCRIPT = re.compile(r"```python\n(.*?)```", re.DOTALL)
SIZE, SPP = (192, 144), 256

CAMERA = {"type": "perspective", "eye": [0, 1.7, 4.6], "target": [0, 0.72, 0], "fov": 30, "resolution": SIZE}
MATERIALS = {"grey": {"kd": 0.6}, "floor": {"kd": [0.5, 0.48, 0.45]}, "lamp": {"emission": [21, 18, 14]}}
FLOOR = {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "floor"}
LAMP = {
    "procedural": {"name": "rectangle", "corner": [-2.6, 2.6, 0.6], "edge1": [1.2, 0.5, 0], "edge2": [0, 0, 1.4]},
    "material": "lamp",
}
SKY = {"environment": {"radiance": [0.2, 0.25, 0.33]}}


def staged(piece: dict[str, Any]) -> dict[str, Any]:
    """A whole scene around a piece of one."""
    own = piece.get("materials", {})
    radius = 0.7 if "lights" in piece else 0.8
    ball = {"sphere": {"center": [0, radius, 0], "radius": radius}, "material": next(iter(own), "grey")}
    shapes = list(piece.get("shapes", [ball]))
    if not any("plane" in shape for shape in shapes):
        shapes.append(FLOOR)
    lights = piece.get("lights")
    if lights is None:
        lights = [SKY]
        shapes.append(LAMP)
    return {
        "raybench_scene": 1,
        "camera": CAMERA,
        "textures": piece.get("textures", {}),
        "materials": MATERIALS | own,
        "shapes": shapes,
        "lights": lights,
    }


def main(wanted: list[str]) -> None:
    page = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    for script in SCRIPT.findall(page):  # it writes the files that pieces name
        exec(script)
    given = {name: yaml.safe_load(text) for name, text in WHOLE.findall(page)}
    given |= {name: staged(yaml.safe_load(text)) for name, text in BLOCK.findall(page)}
    PICTURES.mkdir(exist_ok=True)
    for name in wanted or given:
        scene = engines.scene_from(given[name])
        settings = engines.Settings(precision="float32", shader={"name": "path_tracer", "max_depth": 8}, threads=2)
        engines.engine("embree").prepare(scene, settings).render(SPP).save(PICTURES / f"{name}.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        main(sys.argv[1:])
