"""Media in Mitsuba's terms, which stand beside the shapes and the sensor that are in them."""

from __future__ import annotations

from engines.peers.mitsuba.nodes import Node, rgb
from engines.scene import HomogeneousMedium, Scene, Single
from engines.scene.media import SIDES


def medium_node(medium: HomogeneousMedium) -> Node:
    """Mitsuba takes colours of at most 1: `scale` makes larger extinctions of them."""
    scale = max(medium.sigma_t)
    phase: Node = {"type": "hg", "g": float(medium.g)} if medium.g else {"type": "isotropic"}
    shares = [value / scale for value in medium.sigma_t]
    return {"type": "homogeneous", "sigma_t": rgb(shares), "scale": float(scale), "albedo": rgb(medium.albedo), "phase": phase}


def reference(index: int) -> Node:
    """A medium of the scene where it is used."""
    return {"type": "ref", "id": f"medium_{index}"}


def sides_node(shape: Single, turned: bool) -> Node:
    """The media on the sides of a shape; those of its back, where it is `turned`."""
    names = SIDES[::-1] if turned else SIDES
    named = zip(names, (shape.interior, shape.exterior), strict=True)
    return {name: reference(index) for name, index in named if index is not None}


def media_lack(scene: Scene) -> str | None:
    """One sentence on what Mitsuba does not support of the media, or None."""
    for medium in scene.media:
        if min(medium.sigma_t) == 0.0:
            return f"medium {medium.name!r}: Mitsuba's volpath needs a sigma_t above 0 in every channel"
    return None
