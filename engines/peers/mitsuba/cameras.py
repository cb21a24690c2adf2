"""Cameras in Mitsuba's terms."""

from __future__ import annotations

import math

import numpy as np

from engines.peers.mitsuba.media import reference
from engines.peers.mitsuba.nodes import Node
from engines.scene import Camera, Orthographic, Perspective, ThinLens
from engines.scene.frames import look_at

NEAR, FAR = 1e-4, 1e7
"""The clipping planes of a camera without its own, in extents of the scene: nothing is meant to be cut off."""


CAMERAS = (Perspective, Orthographic, ThinLens)


def camera_lacks(camera: Camera) -> str | None:
    """What Mitsuba does not support of a camera, or None."""
    if isinstance(camera, ThinLens) and camera.principal_point != (0.0, 0.0):
        return "a thin lens with a principal point"
    return None


def sensor(camera: Camera, width: int, height: int, sampler: Node, size: float) -> Node:
    """A sensor with a film of `width` x `height` pixels and a box filter. `size`: the extent of the scene."""
    assert isinstance(camera, CAMERAS)
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
        "sample_border": False,
    }
    to_world = look_at(camera.eye, camera.target, camera.up)
    if camera.mirror:
        to_world = to_world @ np.diag([-1.0, 1.0, 1.0, 1.0])
    near, far = camera.clip
    lens: Node = {"near_clip": max(near, NEAR * size), "far_clip": FAR * size if math.isinf(far) else far}
    if camera.medium is not None:
        lens["medium"] = reference(camera.medium)
    right, down = camera.principal_point
    if isinstance(camera, Orthographic):
        # Mitsuba's window is two wide and has square pixels, before it is scaled; +x is to the left
        across, high = camera.window(width / height)
        shift = np.eye(4)
        shift[:2, 3] = right * across, down * high
        scale = np.diag([across / 2.0, high / 2.0 * width / height, 1.0, 1.0])
        return {"type": "orthographic", **lens, "to_world": to_world @ shift @ scale, "film": film, "sampler": sampler}
    lens |= {"fov": camera.fov, "fov_axis": camera.fov_axis}
    if isinstance(camera, ThinLens):
        lens |= {"aperture_radius": float(camera.aperture_radius), "focus_distance": float(camera.focus_distance)}
    elif camera.principal_point != (0.0, 0.0):
        lens |= {"principal_point_offset_x": -right, "principal_point_offset_y": -down}
    kind = "thinlens" if isinstance(camera, ThinLens) else "perspective"
    return {"type": kind, **lens, "to_world": to_world, "film": film, "sampler": sampler}
