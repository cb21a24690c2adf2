"""What an adapter for an existing renderer is written with: base classes of its engine and renderer, meshes, camera, seeds.

A renderer with a Python API that returns images needs two small classes, `AdapterEngine` and `ImageRenderer`; the film, passes,
stopping, updates, counters and the choice of settings come with them. See docs/extend/peer.md.
"""

from engines.peers.adapters.engine import AdapterEngine, version_with
from engines.peers.adapters.geometry import CameraFrame, FlatMesh, camera_frame, extent, flat_meshes
from engines.peers.adapters.image_renderer import MEANS_ALONE, ImageRenderer
from engines.peers.adapters.seeds import derive_seed
from engines.peers.adapters.tessellation import sphere_mesh
from engines.scene.frames import tangents

__all__ = [
    "MEANS_ALONE",
    "AdapterEngine",
    "CameraFrame",
    "FlatMesh",
    "ImageRenderer",
    "camera_frame",
    "derive_seed",
    "extent",
    "flat_meshes",
    "sphere_mesh",
    "tangents",
    "version_with",
]
