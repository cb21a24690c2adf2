"""The models of reflection, one a module, and the registry through which the rest of the engine knows them."""

from types import NoneType

from engines.numpy_reference.bsdf.conductor import ConductorBSDF
from engines.numpy_reference.bsdf.interface import BSDF, BSDFSample, Lobes
from engines.numpy_reference.bsdf.mixture import MixtureBSDF
from engines.numpy_reference.bsdf.plugins import PluginBSDF
from engines.scene import Conductor, CustomBSDF

BSDFS: dict[type, type[BSDF]] = {
    NoneType: MixtureBSDF,
    Conductor: ConductorBSDF,
    CustomBSDF: PluginBSDF,
}
"""For each type of `Material.bsdf`, the class that holds all materials of that model; None stands for kd, ks and kt."""

__all__ = ["BSDF", "BSDFS", "BSDFSample", "Lobes"]
