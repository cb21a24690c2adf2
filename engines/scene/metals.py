"""Complex indices of refraction of metals in linear sRGB: `METALS[name]` is (eta, k).

Source: the measured spectra that Mitsuba 3.9.1 ships (luxpop.com; tungsten: LLNL CXRO and Palik), each integrated over 360 to
830 nm with the CIE 1931 colour matching functions, divided by 106.75026, converted to linear sRGB without adaptation and
clamped at 0. These are the values that Mitsuba's RGB variants evaluate for `material="Au"` and so on.
"""

from __future__ import annotations

from engines.scene.triple import Triple

METALS: dict[str, tuple[Triple, Triple]] = {
    "Ag": ((0.15528, 0.11673, 0.13839), (4.82835, 3.12222, 2.14690)),
    "Al": ((1.65750, 0.88040, 0.52124), (9.22381, 6.26950, 4.83700)),
    "Au": ((0.14304, 0.37531, 1.44205), (3.98300, 2.38556, 1.60336)),
    "Cr": ((4.36967, 2.91651, 1.65490), (5.20655, 4.23131, 3.75470)),
    "Cu": ((0.20101, 0.92375, 1.10222), (3.91326, 2.45305, 2.14209)),
    "Hg": ((2.39894, 1.44003, 0.90957), (6.32759, 4.37192, 3.42176)),
    "Ir": ((3.08630, 2.08219, 1.61791), (5.59215, 4.06709, 3.26731)),
    "Mo": ((4.48397, 3.52513, 2.77631), (4.11144, 3.42083, 3.15061)),
    "Rh": ((2.58579, 1.86022, 1.55426), (6.78226, 4.70299, 3.97607)),
    "W": ((4.37082, 3.30025, 2.99841), (3.50064, 2.60487, 2.27323)),
}
