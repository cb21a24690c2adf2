"""Sampled spectra as linear RGB.

The CIE 1931 standard colorimetric observer (2 degrees) and the standard illuminant D65, at 360 to 830 nm in steps of 5 nm, both
piecewise linear. A spectrum of light is integrated with the observer, one of a reflectance or an index with the observer and
D65, so that a reflectance of 1 is white; both without adaptation, as in Mitsuba 3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.triple import Triple, triple

FLAT_SPECTRUM: Triple = (1.20479, 0.94829, 0.90892)
"""The light of a spectrum that is 1 at every wavelength."""

FIRST, STEP = 360.0, 5.0
XYZ_TO_RGB = np.array([[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]])

_TABLE = """
    0.0001299 3.917e-06 0.0006061 46.638; 0.0002321 6.965e-06 0.001086 49.364; 0.0004149 1.239e-05 0.001946 52.089;
    0.0007416 2.202e-05 0.003486 51.032; 0.001368 3.9e-05 0.00645 49.976; 0.002236 6.4e-05 0.01055 52.312;
    0.004243 0.00012 0.02005 54.648; 0.00765 0.000217 0.03621 68.702; 0.01431 0.000396 0.06785 82.755;
    0.02319 0.00064 0.1102 87.12; 0.04351 0.00121 0.2074 91.486; 0.07763 0.00218 0.3713 92.459;
    0.13438 0.004 0.6456 93.432; 0.21477 0.0073 1.03905 90.057; 0.2839 0.0116 1.3856 86.682;
    0.3285 0.01684 1.62296 95.774; 0.34828 0.023 1.74706 104.87; 0.34806 0.0298 1.7826 110.94;
    0.3362 0.038 1.77211 117.01; 0.3187 0.048 1.7441 117.41; 0.2908 0.06 1.6692 117.81;
    0.2511 0.0739 1.5281 116.34; 0.19536 0.09098 1.28764 114.86; 0.1421 0.1126 1.0419 115.39;
    0.09564 0.13902 0.81295 115.92; 0.05795 0.1693 0.6162 112.37; 0.03201 0.20802 0.46518 108.81;
    0.0147 0.2586 0.3533 109.08; 0.0049 0.323 0.272 109.35; 0.0024 0.4073 0.2123 108.58;
    0.0093 0.503 0.1582 107.8; 0.0291 0.6082 0.1117 106.3; 0.06327 0.71 0.07825 104.79;
    0.1096 0.7932 0.05725 106.24; 0.1655 0.862 0.04216 107.69; 0.22575 0.91485 0.02984 106.05;
    0.2904 0.954 0.0203 104.41; 0.3597 0.9803 0.0134 104.23; 0.43345 0.99495 0.00875 104.05;
    0.51205 1 0.00575 102.02; 0.5945 0.995 0.0039 100; 0.6784 0.9786 0.00275 98.167;
    0.7621 0.952 0.0021 96.334; 0.8425 0.9154 0.0018 96.061; 0.9163 0.87 0.00165 95.788;
    0.9786 0.8163 0.0014 92.237; 1.0263 0.757 0.0011 88.686; 1.0567 0.6949 0.001 89.346;
    1.0622 0.631 0.0008 90.006; 1.0456 0.5668 0.0006 89.803; 1.0026 0.503 0.00034 89.599;
    0.9384 0.4412 0.00024 88.649; 0.85445 0.381 0.00019 87.699; 0.7514 0.321 0.0001 85.494;
    0.6424 0.265 5e-05 83.289; 0.5419 0.217 3e-05 83.494; 0.4479 0.175 2e-05 83.699;
    0.3608 0.1382 1e-05 81.863; 0.2835 0.107 0 80.027; 0.2187 0.0816 0 80.121;
    0.1649 0.061 0 80.215; 0.1212 0.04458 0 81.246; 0.0874 0.032 0 82.278;
    0.0636 0.0232 0 80.281; 0.04677 0.017 0 78.284; 0.0329 0.01192 0 74.003;
    0.0227 0.00821 0 69.721; 0.01584 0.005723 0 70.665; 0.0113592 0.004102 0 71.609;
    0.00811092 0.002929 0 72.979; 0.00579035 0.002091 0 74.349; 0.00410946 0.001484 0 67.977;
    0.00289933 0.001047 0 61.604; 0.00204919 0.00074 0 65.745; 0.00143997 0.00052 0 69.886;
    0.000999949 0.0003611 0 72.486; 0.000690079 0.0002492 0 75.087; 0.000476021 0.0001719 0 69.34;
    0.000332301 0.00012 0 63.593; 0.000234826 8.48e-05 0 55.005; 0.00016615 6e-05 0 46.418;
    0.000117413 4.24e-05 0 56.612; 8.30753e-05 3e-05 0 66.805; 5.87065e-05 2.12e-05 0 65.094;
    4.15099e-05 1.499e-05 0 63.383; 2.93533e-05 1.06e-05 0 63.843; 2.06738e-05 7.4657e-06 0 64.304;
    1.45598e-05 5.2578e-06 0 61.878; 1.0254e-05 3.7029e-06 0 59.452; 7.22146e-06 2.6078e-06 0 55.705;
    5.08587e-06 1.8366e-06 0 51.959; 3.58165e-06 1.2934e-06 0 54.7; 2.52252e-06 9.1093e-07 0 57.441;
    1.77651e-06 6.4153e-07 0 58.877; 1.25114e-06 4.5181e-07 0 60.313;
"""
"""x, y, z, D65 of each wavelength."""


def rgb_of_samples(samples: NDArray[np.float64], light: bool) -> Triple:
    """Linear RGB, which may be negative, of (2, n) growing wavelengths and values; 0 beyond them, linear between them."""
    x, y, z, d65 = _table()
    wavelengths = FIRST + np.arange(len(x))
    values = np.interp(wavelengths, *samples, left=0.0, right=0.0)
    weight = np.ones_like(d65) if light else d65
    xyz = np.array([curve @ (values * weight) for curve in (x, y, z)]) / (y @ weight)
    return triple(XYZ_TO_RGB @ xyz)


def rgb_of_black_body(kelvin: float) -> Triple:
    """Linear RGB of the radiance that a black body has at a nanometre of wavelength (Planck), in W / (m^2 sr nm)."""
    wavelengths = np.arange(FIRST, FIRST + STEP * 94.5)
    with np.errstate(over="ignore"):
        radiance = 1.19104297e20 / wavelengths**5 / np.expm1(1.438776877e7 / (wavelengths * kelvin))
    return triple(max(0.0, x) for x in rgb_of_samples(np.stack([wavelengths, radiance]), light=True))


def _table() -> NDArray[np.float64]:
    """(4, 471) the curves in steps of 1 nm."""
    rows = np.array([row.split() for row in _TABLE.replace("\n", " ").split(";") if row.strip()], np.float64)
    coarse = FIRST + STEP * np.arange(len(rows))
    return np.stack([np.interp(np.arange(coarse[0], coarse[-1] + 0.5), coarse, column) for column in rows.T])
