"""N. Dahlquist's CPU ray tracer for Android (2012), from its facts: the frames equal the original's, byte for byte.

`Tracer` makes frame calls; `pictures` holds the probe and the background that stand in for the original's photographs.
"""

from engines.dahlquist.animation import COLOURS, RADII, Animation
from engines.dahlquist.frame import BACKGROUND, SPHERE, Frame
from engines.dahlquist.pictures import PROBES, checker_probe, formula_background, read_picture, smooth_probe
from engines.dahlquist.tracer import ENGINES, Tracer

__all__ = [
    "BACKGROUND",
    "COLOURS",
    "ENGINES",
    "PROBES",
    "RADII",
    "SPHERE",
    "Animation",
    "Frame",
    "Tracer",
    "checker_probe",
    "formula_background",
    "read_picture",
    "smooth_probe",
]
