"""Generated shapes as tests ask for them, and what makes a mesh a solid."""

from __future__ import annotations

import numpy as np

import engines


def shape(**options):
    data = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
        "materials": {"m": {"kd": 0.5}},
        "shapes": [{"procedural": options, "material": "m"}],
    }
    scene = engines.scene_from(data)
    assert not any("area" in warning for warning in scene.warnings)
    return scene.shapes[0]


def signed_volume(mesh):
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum()) / 6.0


def is_closed(mesh):
    """Every edge is used once in each direction."""
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forward = {tuple(edge) for edge in edges.tolist()}
    return len(forward) == len(edges) and all((b, a) in forward for a, b in forward)
