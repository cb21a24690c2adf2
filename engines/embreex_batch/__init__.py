"""The engine `embreex_batch`: embreex as it is shipped, which gets a whole wavefront of rays at a time, shaded in NumPy.

What a user of Python has today without compiling anything: `embreex.rtcore_scene.EmbreeScene.run` finds the triangles
and `engines.numpy_reference` does the rest. The distance to `embree`, which calls the same library from compiled code,
is the price of the round trips.
"""

from engines.embreex_batch.engine import Engine

__all__ = ["Engine"]
