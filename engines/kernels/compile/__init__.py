"""The only package that uses Numba's internals and LLVM: compilation, the disk cache of machine code, and the types of values
in kernels."""

from __future__ import annotations

import numba
from numba import config

from engines.errors import Unsupported
from engines.packages import install

OLDEST, NEWEST = (0, 67), (0, 68)
"""The versions of Numba between which the modules here were tested: they use parts of it that are not public."""

PRIVATE = {
    "numba.core.dispatcher:Dispatcher._compile_for_args": "compilation that Python's calls set off is timed",
    "numba.core.codegen:CPUCodegen._function_pass_manager": "loops are not unrolled before what they call is inlined",
    "numba.core.codegen:CPUCodeLibrary._optimize_final_module": "inlined code is optimised where it is inlined, only there",
    "numba.core.codegen:CPUCodeLibrary._finalize_final_module": "and is not linked",
    "numba.core.codegen:CPUCodeLibrary._finalize_dynamic_globals": "as Numba's own end of a library does",
    "numba.core.codegen:CPUCodeLibrary._verify_declare_only_symbols": "as Numba's own end of a library does",
    "numba.core.caching:CacheImpl._locator_classes": "machine code is kept in a folder of raybench's",
    "numba.core.caching:Cache._index_key": "under keys that are the same in every process",
    "numba.core.caching:Cache._save_overload": "in files that appear whole",
    "numba.core.caching:Cache._load_overload": "or not at all",
    "numba.core.caching:_CacheLocator": "the class of what finds the folder",
    "numba.extending:_Intrinsic": "what names the intrinsics that a function calls",
}
"""Parts of Numba that are not public, as module:name, and what they are used for."""


def _check_numba() -> None:
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    if not OLDEST <= version <= NEWEST:
        tested = " to ".join(dict.fromkeys(".".join(map(str, bound)) for bound in (OLDEST, NEWEST)))
        raise Unsupported(
            f"numba {numba.__version__} is installed: the engines numba and embree were tested with {tested}; "
            f"install it with: {install(f'numba>={OLDEST[0]}.{OLDEST[1]},<{NEWEST[0]}.{NEWEST[1] + 1}')}"
        )


_check_numba()

# For some processors with 512-bit vectors LLVM prefers half of them. It uses all for a generic processor that has the same
# features. Numba reads this once, before it compiles anything, and for all code of the process.
if config.CPU_NAME is None:
    config.CPU_NAME = ""
