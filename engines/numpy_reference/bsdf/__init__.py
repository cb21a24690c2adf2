"""The models of reflection, one a module, and the registry through which the rest of the engine knows them."""

from engines.numpy_reference.bsdf.interface import BSDF, BSDFSample, Lobes, NullLobes, Refracts
from engines.numpy_reference.registry import collect

BSDFS: dict[type, type[BSDF]] = collect("BSDFS", __name__, __path__)
"""For each model of `engines.scene.bsdf` that is no wrapper, the class that holds all of a scene. From the tables `BSDFS` of
the modules."""

__all__ = ["BSDF", "BSDFS", "BSDFSample", "Lobes", "NullLobes", "Refracts"]
