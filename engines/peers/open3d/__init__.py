"""The engine `open3d`: Open3D's RaycastingScene, which traces rays and renders nothing.

Nothing of Open3D is imported before it is asked whether it can trace.
"""

from engines.peers.open3d.engine import Engine

__all__ = ["Engine"]
