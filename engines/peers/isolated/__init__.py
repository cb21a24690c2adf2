"""An engine in a process of its own, with this Python or with that of another environment.

An engine asks for it by the attribute `own_process = True` on its class, and a user by a Python after the engine's name:
`engine("mitsuba@/path/to/environment")`. `engines.registry.engine` then returns the `Engine` of this package, which starts a
Python, has the engine's own class made there, and passes calls on. Films lie in memory that both processes share.

The process needs NumPy and what the engine imports; raybench's packages are found where they lie here. It ends with the process
that started it, however that ends. It needs file descriptors that are passed to a child: there is none of this on Windows.
"""

from engines.peers.isolated.engine import Engine, Renderer

__all__ = ["Engine", "Renderer"]
