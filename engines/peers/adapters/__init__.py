"""What an adapter for an existing renderer is written with: base classes of its engine and renderer, meshes, camera, seeds.

A renderer with a Python API that returns images needs two small classes, `AdapterEngine` and `ImageRenderer`; the film, passes,
stopping, updates, counters and the choice of settings come with them. See docs/extend/engine.md.
"""

from engines.peers.adapters.colors import mirror_share
from engines.peers.adapters.engine import PLAIN_PATHS, AdapterEngine, version_with
from engines.peers.adapters.geometry import CameraFrame, FlatMesh, camera_frame, extent, flat_meshes
from engines.peers.adapters.image_renderer import MEANS_ALONE, ImageRenderer, derive_seed
from engines.peers.adapters.lacks import mixture_lacks
from engines.peers.adapters.tessellation import cylinder_mesh, disk_mesh, sphere_mesh, squares
from engines.scene.frames import tangents
from engines.scene.tessellate import Triangles

__all__ = [
    "MEANS_ALONE",
    "PLAIN_PATHS",
    "AdapterEngine",
    "CameraFrame",
    "FlatMesh",
    "ImageRenderer",
    "Triangles",
    "camera_frame",
    "cylinder_mesh",
    "derive_seed",
    "disk_mesh",
    "extent",
    "flat_meshes",
    "mirror_share",
    "mixture_lacks",
    "sphere_mesh",
    "squares",
    "tangents",
    "version_with",
]
