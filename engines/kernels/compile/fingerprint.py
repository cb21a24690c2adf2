"""A name for a function that is the same in every process: its code, what it closes over, and the functions that it
calls.

The sources of raybench's kernels are hashed as a whole (`code_cache.source_hash`), so of their functions the name, the
code and the closure are enough. Of a user's function the globals that it refers to count too: other functions, numbers,
tuples and arrays of them.
"""

from __future__ import annotations

import hashlib
import types as python_types
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.extending import _Intrinsic

_OURS = __name__.partition(".")[0] + "."
_STABLE = {__name__.partition(".")[0], "builtins", "math", "operator", "numpy", "numba"}
"""Packages whose contents are the same for one `source_hash` and one version of NumPy."""


class NotFingerprinted(ValueError):
    """A function depends on a value that has no name that is the same in every process."""


def fingerprint(function: Any) -> str:
    """A hash of everything that the machine code of a Python function depends on, besides the sources of raybench's
    engines.

    Raises `NotFingerprinted`.
    """
    return hashlib.sha256(repr(_function(function, ())).encode()).hexdigest()


def _function(function: Any, within: tuple[Any, ...]) -> Any:
    if function in within:  # it calls itself
        return "recursive", within.index(function)
    within = (*within, function)
    cells = [_value(cell.cell_contents, within) for cell in function.__closure__ or ()]
    code, known = function.__code__, function.__globals__
    named = []
    if not function.__module__.startswith(_OURS):
        named = [(name, _value(known[name], within)) for name in sorted(_names(code)) if name in known]
    return function.__module__, function.__qualname__, _code(code), cells, named


def _code(code: Any) -> Any:
    """Instructions and constants; those of functions within it, too."""
    constants = [_code(x) if isinstance(x, python_types.CodeType) else repr(x) for x in code.co_consts]
    return code.co_code.hex(), constants, code.co_names, code.co_varnames


def _names(code: Any) -> set[str]:
    inner = (x for x in code.co_consts if isinstance(x, python_types.CodeType))
    return set(code.co_names).union(*(_names(x) for x in inner))


def _class(value: type, within: tuple[Any, ...]) -> Any:
    """A class by its name; a user's must be a layout (`records`) or a NamedTuple, whose fields count."""
    name = value.__module__, value.__qualname__
    fields = getattr(value, "fields", None)
    if isinstance(fields, dict):
        return name, [
            (key, field.kind, field.n, field.first, str(field.dtype), field.row and _class(field.row, within))
            for key, field in fields.items()
        ]
    if name[0].partition(".")[0] in _STABLE:
        return name
    if issubclass(value, tuple) and hasattr(value, "_fields"):
        return name, value._fields
    raise NotFingerprinted(f"{value!r}: the name of a class does not identify its contents")


def _value(value: Any, within: tuple[Any, ...]) -> Any:
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes, np.number, np.bool_)):
        return type(value).__name__, repr(value)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        value = "array", value.dtype.str, value.shape, hashlib.sha256(np.ascontiguousarray(value)).hexdigest()
    if isinstance(value, tuple):
        return type(value).__qualname__, [_value(part, within) for part in value]
    if isinstance(value, Dispatcher):
        options = sorted((name, repr(option)) for name, option in value.targetoptions.items())
        return "jitted", options, _function(value.py_func, within)
    if isinstance(value, _Intrinsic):
        return "intrinsic", _function(value._defn, within)
    if isinstance(value, python_types.FunctionType):
        return "function", _function(value, within)
    if isinstance(value, type):
        return _class(value, within)
    if isinstance(value, python_types.ModuleType) and value.__name__.partition(".")[0] in _STABLE:
        return "module", value.__name__
    if isinstance(value, (python_types.BuiltinFunctionType, np.ufunc, np.dtype)):
        return type(value).__name__, str(value)
    raise NotFingerprinted(f"{value!r}: a value of type {type(value).__name__} has no name that every process shares")
