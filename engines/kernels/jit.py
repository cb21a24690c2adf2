"""How kernels are compiled: options in one place, stages by address, and memory with known aliasing.

A *stage* is a C function `void(block, world)` of two addresses, made by a factory that closes over plain values only (a
scalar type, ints, bools). Such a stage is cached on disk and loaded by the next process; one that closes over another
jitted function (a user's plugin) is compiled anew in each. The driver calls stages by address, so compile times add up
rather than multiply.
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
from llvmlite import ir
from numba import types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from engines.kernels.code_cache import cached
from engines.kernels.simd_types import Mask, Simd, call_vector, spread

LANES = 16
"""Lanes of a block: one 512-bit vector of float32."""

# The default error model puts an early exit into every loop with a division, and then nothing vectorises.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}

compile_seconds = 0.0
"""Seconds this process has spent compiling or loading kernels and stages; what two threads wait for at once counts once."""
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


def kernel(function: Callable[..., Any]) -> Any:
    """A jitted function that Python calls: releases the GIL, kept on disk."""
    dispatcher = numba.njit(nogil=True, **OPTIONS)(function)
    dispatcher._cache = cached(function)
    compile_for = dispatcher._compile_for_args

    def timed(*arguments: Any, **named: Any) -> Any:
        with _timed_compilation():
            return compile_for(*arguments, **named)

    dispatcher._compile_for_args = timed
    return dispatcher


def inline(function: Callable[..., Any]) -> Any:
    """A jitted function of one lane, inlined into the loop over lanes so that the loop can become vector code.

    What compiled code calls has no way in from Python, which saves a fifth of a cold start; a call from Python compiles
    the function once more.
    """
    dispatcher = numba.njit(forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS)(function)

    def remember(compiled: Any) -> None:
        """Numba's own enters the function where Python looks for it, and a call from Python crashes."""
        dispatcher.overloads[tuple(compiled.signature.args)] = compiled

    @cache
    def from_python() -> Any:
        return numba.njit(**OPTIONS)(function)

    dispatcher.add_overload = remember
    dispatcher._compile_for_args = lambda *arguments, **named: from_python()._compile_for_args(*arguments, **named)
    return dispatcher


_STAGE = types.void(types.int64, types.int64)


def compile_stage(function: Callable[..., Any], on_disk: bool = True) -> Any:
    """Compiles `function(block, world)`; the result has `.address` and must be kept alive while that is used."""
    return compile_function(function, _STAGE, on_disk)


def compile_function(function: Callable[..., Any], signature: Any, on_disk: bool = True) -> Any:
    """Compiles a C function of the given numba signature."""
    compiled = CFunc(function, (signature.args, signature.return_type), locals={}, options=dict(OPTIONS))
    if on_disk:
        compiled._cache = cached(function)
    with _timed_compilation():
        compiled.compile()
    return compiled


# ---- calls and atomics -----------------------------------------------------------------------------------------------


@intrinsic
def call_stage(typing, stage, block, world):
    """Calls the stage at address `stage`."""

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


@intrinsic
def lowest_bit(typing, word):
    """The index of the lowest bit that is set in a word that is not 0."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


@intrinsic
def highest_bit(typing, word):
    """The index of the highest bit that is set in a word that is not 0."""

    def generate(context, builder, signature, arguments):
        zeros = builder.ctlz(arguments[0], ir.Constant(ir.IntType(1), 1))
        return builder.sub(ir.Constant(ir.IntType(64), 63), zeros)

    return types.int64(types.int64), generate


@intrinsic
def float_bits(typing, x):
    """The bits of a float32 as an int32: positive ones sort like their bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(32))

    return types.int32(types.float32), generate


@intrinsic
def bits_set(typing, word):
    """How many bits of a word are set."""

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.int64(types.int64), generate


@intrinsic
def fetch_add(typing, address, amount):
    """Adds to the int64 at `address` atomically and returns what was there before."""

    def generate(context, builder, signature, arguments):
        pointer = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        return builder.atomic_rmw("add", pointer, arguments[1], "monotonic")

    return types.int64(types.int64, types.int64), generate


# ---- values ----------------------------------------------------------------------------------------------------------


@intrinsic
def select(typing, condition, yes, no):
    """`yes` where `condition` holds, else `no`, both evaluated: never a branch, so loops over lanes stay vector code. Of a
    mask (`simd`) it selects number by number, and a plain number stands for eight."""
    result = no if isinstance(no, Simd) else yes

    def generate(context, builder, signature, arguments):
        values = [
            spread(builder, x if kind == result else context.cast(builder, x, kind, result.kind))
            if isinstance(result, Simd)
            else x
            for x, kind in zip(arguments[1:], signature.args[1:], strict=True)
        ]
        return builder.select(arguments[0], *values)

    if isinstance(condition, Mask):
        return result(condition, yes, no), generate
    return result(types.boolean, result, result), generate


@intrinsic
def fma(typing, a, b, c):
    """a b + c, rounded once."""

    def generate(context, builder, signature, arguments):
        if isinstance(a, Simd):
            return call_vector(builder, "fma", arguments)
        return builder.fma(*arguments)

    return a(a, a, a), generate


@intrinsic
def const(typing, value, like):
    """The number `value` in the type of `like`: a bare Python literal would turn float32 arithmetic into float64."""
    kind = like.kind if isinstance(like, Simd) else getattr(like, "dtype", like)

    def generate(context, builder, signature, arguments):
        return context.cast(builder, arguments[0], signature.args[0], kind)

    return kind(value, like), generate


# ---- memory ----------------------------------------------------------------------------------------------------------
# A block (the lanes' state, written) and everything else (the world, read; scratch) never overlap. Saying so on each
# access is what lets LLVM vectorise loops that gather from the world while they write the block.


def tag_access(module: Any, access: Any, of_block: bool) -> None:
    domain = module.add_metadata([ir.MetaDataString(module, "raybench")])
    block = module.add_metadata([module.add_metadata([ir.MetaDataString(module, "block"), domain])])
    world = module.add_metadata([module.add_metadata([ir.MetaDataString(module, "world"), domain])])
    access.set_metadata("alias.scope", block if of_block else world)
    access.set_metadata("noalias", world if of_block else block)


def _slot(builder: Any, arguments: Any) -> Any:
    index = builder.add(builder.mul(arguments[1], ir.Constant(ir.IntType(64), LANES)), arguments[2])
    return builder.gep(arguments[0], [index])


def _load(builder: Any, address: Any, of_block: bool) -> Any:
    value = builder.load(address)
    tag_access(builder.module, value, of_block)
    return value


def _store(builder: Any, value: Any, address: Any, of_block: bool) -> None:
    tag_access(builder.module, builder.store(value, address), of_block)


def _word(real: Any) -> Any:
    return types.int32 if real == types.float32 else types.int64


@intrinsic
def pointer(typing, address, kind):
    """A typed pointer to `address`; `kind` is a scalar type such as np.float32."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(kind.dtype)(types.int64, kind), generate


@intrinsic
def get(typing, block, field, lane):
    """The number in `field` of `lane`."""

    def generate(context, builder, signature, arguments):
        return _load(builder, _slot(builder, arguments), True)

    return block.dtype(block, types.int64, types.uint64), generate


@intrinsic
def put(typing, block, field, lane, value):
    """Writes the number `value` into `field` of `lane`."""

    def generate(context, builder, signature, arguments):
        _store(builder, arguments[3], _slot(builder, arguments), True)
        return context.get_dummy_value()

    return types.void(block, types.int64, types.uint64, block.dtype), generate


@intrinsic
def get_int(typing, block, field, lane):
    """The integer whose bits `field` of `lane` holds: int32 in a float32 block, int64 in a float64 block."""
    word = _word(block.dtype)

    def generate(context, builder, signature, arguments):
        return builder.bitcast(_load(builder, _slot(builder, arguments), True), context.get_value_type(word))

    return word(block, types.int64, types.uint64), generate


@intrinsic
def put_int(typing, block, field, lane, value):
    """Writes the bits of the integer `value` into `field` of `lane`."""
    word = _word(block.dtype)

    def generate(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[3], context.get_value_type(block.dtype))
        _store(builder, bits, _slot(builder, arguments), True)
        return context.get_dummy_value()

    return types.void(block, types.int64, types.uint64, word), generate


@intrinsic
def fetch(typing, table, index):
    """`table[index]` of the world or of scratch memory; the index is not checked."""

    def generate(context, builder, signature, arguments):
        return _load(builder, builder.gep(arguments[0], [arguments[1]]), False)

    return table.dtype(table, types.int64), generate


def _slot_value(builder: Any, arguments: Any) -> Any:
    slots = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
    return _load(builder, builder.gep(slots, [arguments[1]]), False)


@intrinsic
def table(typing, world, slot, kind):
    """A typed pointer to the array in a slot of the world at address `world`."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(_slot_value(builder, arguments), context.get_value_type(signature.return_type))

    return types.CPointer(kind.dtype)(types.int64, types.int64, kind), generate


@intrinsic
def count(typing, world, slot):
    """The number in a slot of the world at address `world`."""

    def generate(context, builder, signature, arguments):
        return _slot_value(builder, arguments)

    return types.int64(types.int64, types.int64), generate


@intrinsic
def keep(typing, table, index, value):
    """Writes `table[index]` of scratch memory."""

    def generate(context, builder, signature, arguments):
        _store(builder, arguments[2], builder.gep(arguments[0], [arguments[1]]), False)
        return context.get_dummy_value()

    return types.void(table, types.int64, table.dtype), generate
