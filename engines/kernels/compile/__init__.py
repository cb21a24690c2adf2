"""The only package that uses Numba's internals and LLVM: compilation, the disk cache of machine code, and the types of values
in kernels."""

from __future__ import annotations

import numba

from engines.errors import Unsupported
from engines.packages import install

OLDEST, NEWEST = (0, 67), (0, 68)
"""The versions of Numba between which the modules here were tested: they use parts of it that are not public."""


def _check_numba() -> None:
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    if not OLDEST <= version <= NEWEST:
        tested = " to ".join(dict.fromkeys(".".join(map(str, bound)) for bound in (OLDEST, NEWEST)))
        raise Unsupported(
            f"numba {numba.__version__} is installed: the engines numba and embree were tested with {tested}; "
            f"install it with: {install(f'numba>={OLDEST[0]}.{OLDEST[1]},<{NEWEST[0]}.{NEWEST[1] + 1}')}"
        )


_check_numba()
