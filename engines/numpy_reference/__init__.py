"""The engine `numpy`, the project's oracle: NumPy in float64, its own formulas, one concept a file.

Read `path_tracer.py` first; `docs/transport.md` is the specification of every estimator and random number. Vectors of n
rays have shape (3, n). It shares no code with the compiled engines but scenes, films and the Sobol table.

The shaders know shapes, lights and BSDFs by their verbs only. Each kind is a module of `shapes/`, `lights/` or `bsdf/`,
which that package finds; its `interface.py` says what the verbs are. How hits are found is in `accelerators/`.
"""

from engines.numpy_reference.engine import Engine

__all__ = ["Engine"]
