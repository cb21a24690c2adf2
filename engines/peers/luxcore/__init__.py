"""The engine `luxcore`: LuxCoreRender's path tracer on the CPU (PATHCPU), in a process of its own.

Nothing of it is imported before an engine is asked to render.
"""

from engines.peers.luxcore.engine import Engine

__all__ = ["Engine"]
