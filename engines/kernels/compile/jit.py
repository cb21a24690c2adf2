"""How kernels are compiled: Numba's options in one place, and stages, which are called through function pointers.

A *stage* is a C function `void(batch, scene)` of two addresses. A factory makes it from plain values (a scalar type,
ints, bools, tuples of them) and from jitted functions; both are part of the key under which its machine code is kept on
disk. The driver calls stages through function pointers, so compile times add up rather than multiply.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numba
from llvmlite import binding as llvm
from numba import types
from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from engines.kernels.compile.code_cache import cached
from engines.kernels.compile.weak_literals import WeakCompiler

# The default error model puts an early exit into every loop with a division, and then nothing vectorises.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}

compile_seconds = 0.0
"""Seconds this process has spent compiling or loading kernels and stages; what two threads wait for at once counts
once."""
_compiling, _since, _collecting, _lock = 0, 0.0, True, threading.Lock()


@contextmanager
def _timed_compilation() -> Iterator[None]:
    global compile_seconds, _compiling, _since, _collecting
    with _lock:
        if _compiling == 0:
            # Numba makes millions of objects that live on: looking for garbage among them is a sixth of the time.
            _since, _collecting = time.perf_counter(), gc.isenabled()
            gc.disable()
        _compiling += 1
    try:
        yield
    finally:
        with _lock:
            _compiling -= 1
            if _compiling == 0:
                compile_seconds += time.perf_counter() - _since
                if _collecting:
                    gc.enable()


@contextmanager
def _without_early_unrolling() -> Iterator[None]:
    """Numba optimises each function before what it calls is inlined. A loop over lanes that does little but call is then
    unrolled at once, and never becomes vector code; LLVM unrolls loops again after inlining, when it sees what is in them."""
    codegen: Any = cpu_target.target_context.codegen()

    def function_passes() -> tuple[Any, Any]:
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        options.loop_unrolling = False
        builder = llvm.create_pass_builder(codegen._tm, options)
        return builder.getFunctionPassManager(), builder

    with global_compiler_lock:  # other code is compiled as ever
        outer = vars(codegen).get("_function_pass_manager")  # set where one compilation has led to another
        codegen._function_pass_manager = function_passes
        try:
            yield
        finally:
            if outer is None:
                del codegen._function_pass_manager
            else:
                codegen._function_pass_manager = outer


def kernel(function: Callable[..., Any]) -> Any:
    """A jitted function that Python calls: releases the GIL, kept on disk."""
    dispatcher = numba.njit(nogil=True, pipeline_class=WeakCompiler, **OPTIONS)(function)
    dispatcher._cache = cached(function)
    compile_for = dispatcher._compile_for_args

    def timed(*arguments: Any, **named: Any) -> Any:
        with _timed_compilation(), _without_early_unrolling():
            return compile_for(*arguments, **named)

    dispatcher._compile_for_args = timed
    return dispatcher


class _InlineCompiler(WeakCompiler):
    """Makes no machine code."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_compile = True
        return super().define_pipelines()


def inline(function: Callable[..., Any]) -> Any:
    """A jitted function of one lane, inlined into the loop over lanes so that the loop can become vector code.

    No Python wrapper is generated and no machine code of its own; what calls it links and inlines its LLVM code. A call from
    Python compiles the function once more.
    """
    dispatcher = numba.njit(
        forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=_InlineCompiler, **OPTIONS
    )(function)

    def remember(compiled: Any) -> None:
        """Numba's own enters the function where Python looks for it, and a call from Python crashes."""
        overload, library = compiled._replace(entry_point=object()), compiled.library
        library._optimize_final_module = lambda: None  # what it is inlined into is optimised as a whole
        library._finalize_final_module = lambda: _finish_without_code(library)
        cpu_target.target_context.insert_user_function(overload.entry_point, compiled.fndesc, [library])
        dispatcher.overloads[tuple(compiled.signature.args)] = overload

    @cache
    def from_python() -> Any:
        return numba.njit(pipeline_class=WeakCompiler, **OPTIONS)(function)

    dispatcher.add_overload = remember
    dispatcher._compile_for_args = lambda *arguments, **named: from_python()._compile_for_args(*arguments, **named)
    return dispatcher


def _finish_without_code(library: Any) -> None:
    """Ends the making of a library of LLVM code that is linked into others and never called itself."""
    library._finalize_dynamic_globals()
    library._verify_declare_only_symbols()
    library._finalized = True


_STAGE = types.void(types.int64, types.int64)


def compile_stage(function: Callable[..., Any], on_disk: bool = True) -> Any:
    """Compiles `function(batch, scene)`; the result has `.address` and must be kept alive while that is used."""
    return compile_function(function, _STAGE, on_disk)


def compile_callback(function: Callable[..., Any]) -> Any:
    """Compiles `function(arguments)` of one address to a C function; the result as of `compile_stage`."""
    return compile_function(function, types.void(types.int64))


def compile_function(function: Callable[..., Any], signature: Any, on_disk: bool = True) -> Any:
    """Compiles a C function of the given numba signature."""
    compiled = CFunc(function, (signature.args, signature.return_type), {}, dict(OPTIONS), WeakCompiler)
    if on_disk:
        compiled._cache = cached(function)
    with _timed_compilation(), _without_early_unrolling():
        compiled.compile()
    return compiled
