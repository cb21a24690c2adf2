"""Scene files: damaged trees, words and bytes. What still loads is rendered at 4 x 4 pixels by the NumPy engine."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import yaml

import engines
from engines.image import png_bytes
from tests.fuzz.mutate import mutated_bytes, mutated_text, mutated_tree, scaled_tree

TREE = {
    "raybench_scene": 1,
    "name": "a scene",
    "camera": {
        "type": "perspective",
        "eye": [0.1, 1.0, 5.0],
        "target": [0.0, 1.0, 0.0],
        "up": [0.0, 1.0, 0.0],
        "fov": 40.0,
        "fov_axis": "x",
        "resolution": [8, 8],
    },
    "textures": {
        "tiles": {"checkerboard": {"a": [0.5, 0.25, 0.5], "b": 0.2}, "scale": [4.0, 2.0], "offset": [0.5, 0.0]},
        "map": {
            "image": "t.png",
            "color_space": "raw",
            "filter": "nearest",
            "wrap": "mirror",
            "to_uv": [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0]],
        },
    },
    "materials": {
        "m": {"kd": [0.5, 0.4, 0.3]},
        "lamp": {"emission": 1e-3, "two_sided": True},
        "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
        "gold": {"conductor": {"metal": "Au", "alpha": [0.1, 0.2]}},
        "leaf": {"mask": {"opacity": "map", "of": "relief"}},
        "paint": {"principled": {"base_color": "tiles"}},
        "relief": {"bump": {"height": "map", "scale": 0.5, "of": {"kd": "map", "sides": "front"}}},
        "worn": {"blend": {"weight": 0.5, "a": "paint", "b": {"normal_map": {"map": "map", "of": "varnish"}}}},
        "varnish": {"plastic": {"diffuse": "tiles", "alpha": 0.1}},
        "frosted": {"dielectric": {"alpha": [0.1, "map"]}},
        "sided": {"by_side": {"front": "m", "back": {"thin_dielectric": {"ior": 1.5}}}},
        "air": {"null": {}},
        "metal": {"conductor": {"eta": [0.5, 1.5, 2.5], "k": 3.5, "alpha": 0.5, "specular_reflectance": 0.5}},
    },
    "shapes": [],
    "lights": [
        {"point": {"position": [0.5, 3.0, 0.5], "intensity": 10.0, "falloff": "none"}},
        {"directional": {"direction": [0.1, -1.0, 0.1], "irradiance": 1.0}},
        {"environment": {"radiance": [1.0, 0.5, 0.25]}},
        {
            "spot": {
                "position": [0.5, 3.0, 0.5],
                "target": [0.5, 0.5, 0.0],
                "intensity": 1.0,
                "cutoff": 30.0,
                "beam_width": 20.0,
                "texture": "map",
                "up": [0.0, 0.5, 1.0],
            }
        },
        {
            "projector": {
                "position": [0.5, 3.0, 0.5],
                "direction": [0.5, -1.0, 0.5],
                "up": [0.5, 0.5, 1.0],
                "irradiance": [1.0, 0.5, 0.25],
                "texture": "tiles",
                "fov": 30.0,
                "fov_axis": "x",
            }
        },
    ],
}
IMAGE = png_bytes(np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * np.uint8(5))
"""The file `t.png` of the texture `map`."""
SHAPES = [
    {"sphere": {"center": [0.5, 0.5, 0.5], "radius": 1.5}, "material": "m"},
    {"sphere": {"center": [0.5, 0.5, 0.5], "radius": 0.5}, "material": "metal"},
    {"disk": {"center": [0.5, 1.5, 0.5], "normal": [0.1, 1.0, 0.1], "radius": 0.5}, "material": "gold"},
    {"cylinder": {"p0": [0.5, 0.5, 0.5], "p1": [0.5, 1.5, 0.5], "radius": 0.5}, "material": "leaf"},
    {"spheres": {"centers": [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]], "radii": [0.5, 0.25]}, "material": "worn"},
    {
        "mesh": {
            "vertices": [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 1.5, 0.5]],
            "faces": [[0, 1, 2]],
            "uvs": [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]],
            "transform": [[1.0, 0.5, 0.0, 0.5], [0.0, 1.0, 0.0, 0.5], [0.0, 0.0, 1.0, 0.5]],
        },
        "material": "frosted",
    },
    {"plane": {"point": [0.0, -1.0, 0.0], "normal": [0.1, 1.0, 0.1]}, "material": "m"},
    {"triangle": {"a": [0.5, 0.5, 0.5], "b": [1.5, 0.5, 0.5], "c": [0.5, 1.5, 0.5]}, "material": "lamp"},
    {
        "mesh": {
            "vertices": [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 1.5, 0.5]],
            "faces": [[0, 1, 2]],
            "smooth": True,
            "scale": 2.0,
            "translate": [0.5, 1.5, 0.5],
        },
        "material": "glass",
    },
    {"mesh": {"file": "m.obj", "scale": [1.0, 2.0, 3.0], "smooth": True}, "material": "m"},
]
PROCEDURAL = [
    {"name": "sphereflake", "level": 1, "radius": 0.5},
    {"name": "tessellated_sphere", "subdivisions": 1, "radius": 1.0},
    {"name": "box", "half_size": [0.5, 0.5, 0.5], "rotate_y": 30.0},
    {"name": "mount", "level": 2, "roughness": 0.5},
    {"name": "quad", "points": [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [1.5, 1.5, 0.5], [0.5, 1.5, 0.5]]},
    {"name": "rectangle", "corner": [0.5, 0.5, 0.5], "edge1": [1.0, 0.5, 0.5], "edge2": [0.5, 1.0, 0.5]},
    {"name": "terrain", "cells": 4, "size": 10.0, "height": 2.0, "seed": 0},
    {"name": "tetra", "level": 1, "radius": 1.0},
    {"name": "torus_knot", "p": 2, "q": 3, "segments": 16, "sides": 4, "radius": 1.0, "tube": 0.2},
    {"name": "rings", "level": 1, "part": "rods", "sides": 4, "rod": 0.07},
    {"name": "gears", "level": 1, "radius": 0.5},
    {"name": "lattice", "level": 1, "part": "joints", "cell": 0.25, "joint": 0.16},
    {"name": "teapot", "segments": 1},
    {"name": "tree", "level": 2, "part": "rods", "height": 1.0},
    {"name": "stadium", "tiers": 2, "segments": 8, "size": 9.0},
]
CAMERAS = [
    {"type": "orthographic", "eye": [0.1, 1.0, 5.0], "target": [0.0, 1.0, 0.0], "height": 3.0},
    {
        "type": "thin_lens",
        "eye": [0.1, 1.0, 5.0],
        "target": [0.0, 1.0, 0.0],
        "aperture_radius": 0.5,
        "focus_distance": 2.5,
        "principal_point": [0.5, -0.5],
        "mirror": True,
        "clip": [0.5, 50.0],
    },
    {"type": "perspective_arctan", "eye": [0.1, 1.0, 5.0], "target": [0.0, 1.0, 0.0], "fov": 40.0},
]


def write(random: Random, folder: Path) -> None:
    """A folder with `s.yaml`, and the mesh and the image that it may name."""
    (folder / "t.png").write_bytes(IMAGE)
    (folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    tree = TREE | {"shapes": random.sample(SHAPES, 3)}
    tree["shapes"].append({"procedural": random.choice(PROCEDURAL), "material": "glass"})
    if random.random() < 0.3:
        tree["camera"] = random.choice(CAMERAS)
    way = random.randrange(4)
    if way < 2:
        tree = (mutated_tree if way == 0 else scaled_tree)(random, tree)
    text = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, allow_unicode=True)
    if way == 2:
        text = mutated_text(random, text)
    content = text.encode()
    (folder / "s.yaml").write_bytes(mutated_bytes(random, content) if way == 3 else content)


def read(folder: Path) -> None:
    """Loads and renders."""
    scene = engines.load_scene(folder / "s.yaml")
    engine, settings = engines.engine("numpy"), engines.Settings(width=4, height=4)
    if engine.why_not(scene, settings) is None:
        film = engine.prepare(scene, settings).render(1)
        assert np.isfinite(film.mean()).all()
