"""glTF 2.0: a `.glb` or `.gltf` file as a scene. What is mapped to what: docs/guides/render_obj.md."""

from engines.scene.gltf.scene import gltf_scene

__all__ = ["gltf_scene"]
