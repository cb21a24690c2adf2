"""Leaves of every BSDF model, ten of those with a value, for tests that compare two implementations of it.

Roughnesses start at 0.02, as far as float32 carries them. Colours and numbers are constants.
"""

from engines.scene import (
    BLACK,
    WHITE,
    Conductor,
    Dielectric,
    Diffuse,
    Mixture,
    Null,
    Plastic,
    Principled,
    Sheen,
    ThinDielectric,
)
from engines.scene.metals import METALS

AMBER, TEAL, ROSE = (0.9, 0.55, 0.1), (0.05, 0.5, 0.6), (0.8, 0.2, 0.35)

CONDUCTORS = [
    Conductor(*METALS["Au"], (0.1, 0.1)),
    Conductor(*METALS["Ag"], (0.02, 0.02)),
    Conductor(*METALS["Al"], (0.05, 0.3)),
    Conductor(*METALS["Al"], (0.3, 0.05), (0.9, 0.5, 0.1)),
    Conductor(*METALS["Cu"], (0.5, 0.5), distribution="beckmann"),
    Conductor(*METALS["Cr"], (1.0, 1.0)),
    Conductor(*METALS["W"], (0.02, 1.0)),
    Conductor(*METALS["Hg"], (0.2, 0.25), (0.3, 1.0, 0.0), "beckmann"),
    Conductor(BLACK, WHITE, (0.4, 0.7), distribution="beckmann"),
    Conductor((1.5, 2.0, 0.7), (0.0, 0.1, 0.5), (0.15, 0.15)),
]
DIELECTRICS = [
    Dielectric(1.5, (0.1, 0.1)),
    Dielectric(1.5, (0.05, 0.3)),
    Dielectric(1.33, (0.02, 0.02)),
    Dielectric(2.4, (0.4, 0.4)),
    Dielectric(1.5, (0.3, 0.3), AMBER, TEAL),
    Dielectric(1.1, (1.0, 1.0)),
    Dielectric(0.7, (0.2, 0.2)),
    Dielectric(1.5, (0.2, 0.2), distribution="beckmann"),
    Dielectric(1.8, (0.5, 0.1), WHITE, ROSE, "beckmann"),
    Dielectric(1.3, (0.05, 0.05), distribution="beckmann"),
]
SMOOTH_PLASTICS = [
    Plastic(),
    Plastic(AMBER, 1.49),
    Plastic(AMBER, 1.49, nonlinear=True),
    Plastic(WHITE, 1.9),
    Plastic(WHITE, 1.9, nonlinear=True),
    Plastic(TEAL, 1.3, reflectance=ROSE),
    Plastic(ROSE, 1.6, nonlinear=True, reflectance=(0.2, 0.4, 0.6)),
    Plastic(BLACK, 1.5),
    Plastic(AMBER, 1.5, reflectance=BLACK),
    Plastic((0.99, 0.5, 0.01), 2.2, nonlinear=True),
]
ROUGH_PLASTICS = [
    Plastic(alpha=0.1),
    Plastic(AMBER, 1.49, 0.1, distribution="beckmann"),
    Plastic(AMBER, 1.49, 0.3, nonlinear=True),
    Plastic(WHITE, 1.9, 0.05),
    Plastic(TEAL, 1.3, 0.6, False, ROSE),
    Plastic(ROSE, 1.6, 0.2, True, (0.2, 0.4, 0.6), "beckmann"),
    Plastic(BLACK, 1.5, 0.02),
    Plastic(AMBER, 1.5, 0.4, False, BLACK),
    Plastic((0.99, 0.5, 0.01), 2.2, 0.15, True),
    Plastic(WHITE, 1.5, 1.0),
]
PRINCIPLED = [
    Principled(),
    Principled(AMBER, 0.2, metallic=1.0),
    Principled(TEAL, 0.4, anisotropic=0.8, metallic=0.6, spec_tint=0.5),
    Principled(ROSE, 0.7, eta=1.3, spec_tint=1.0, sheen=1.0, sheen_tint=0.7),
    Principled(AMBER, 0.5, clearcoat=1.0, clearcoat_gloss=0.3, flatness=0.6),
    Principled(TEAL, 0.3, eta=1.4, spec_trans=1.0),
    Principled(AMBER, 0.5, anisotropic=0.5, eta=1.6, spec_trans=0.7, metallic=0.3, clearcoat=0.5, sheen=0.4),
    Principled(ROSE, 0.9, eta=1.1, spec_tint=0.3, sheen=0.5, sheen_tint=1.0, flatness=1.0),
    Principled(WHITE, 0.15, eta=1.33, spec_trans=0.9, spec_tint=0.4, flatness=0.3),
    Principled(BLACK, 0.6, sheen=1.0, sheen_tint=1.0, spec_tint=1.0, clearcoat=0.7, clearcoat_gloss=0.1),
    Principled(AMBER, 0.3, metallic=0.5, eta=1.0, spec_tint=0.5, clearcoat=0.5),
]
SHEENS = [Sheen(), Sheen((0.4, 0.4, 0.4)), Sheen(TEAL)]
MIXTURES = [
    Mixture((0.6, 0.5, 0.4)),
    Mixture((0.3, 0.2, 0.1), (0.4, 0.3, 0.5), (0.3, 0.3, 0.2), 1.5, True),
    Mixture((0.1, 0.1, 0.1), (0.4, 0.3, 0.5), (0.3, 0.3, 0.2), 1.4, False),
    Mixture(ks=AMBER),
]
SMOOTH = [
    Conductor(*METALS["Au"], reflectance=(1.0, 0.5, 0.25)),
    Dielectric(1.5, (0.0, 0.0), AMBER, TEAL),
    Dielectric(0.75),
    ThinDielectric(1.5, AMBER, TEAL),
    Null(),
]
"""Of delta lobes alone."""
BY_MODEL = {
    "mixture": MIXTURES,
    "diffuse": [Diffuse(), Diffuse(AMBER)],
    "conductor": CONDUCTORS,
    "dielectric": DIELECTRICS,
    "smooth plastic": SMOOTH_PLASTICS,
    "rough plastic": ROUGH_PLASTICS,
    "principled": PRINCIPLED,
    "sheen": SHEENS,
    "smooth": SMOOTH,
}
