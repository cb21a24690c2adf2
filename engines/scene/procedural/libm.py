"""Elementary functions of float64 arrays with the C library's values.

NumPy has others where it finds AVX-512. Their last bits may differ, and with them the content hash of a scene. Scenes whose
generators take only sines, cosines and square roots had equal hashes on machines with and without AVX-512.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def _each(function: Callable[..., float], arguments: int) -> Callable[..., Any]:
    made = np.frompyfunc(function, arguments, 1)

    def apply(*values: ArrayLike) -> Any:
        return np.asarray(made(*values), np.float64)[()]

    return apply


tan, arcsin = _each(math.tan, 1), _each(math.asin, 1)
power = _each(math.pow, 2)
