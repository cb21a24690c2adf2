"""The engine `cycles`: Blender's Cycles on the CPU, in a process of its own, whose Python has bpy (docs/guides/cycles.md).

Nothing of it is imported before an engine is asked to render.
"""

from engines.peers.cycles.engine import Engine

__all__ = ["Engine"]
