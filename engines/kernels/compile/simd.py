"""Vectors of eight numbers as values of compiled code: one ray against eight boxes, or eight primitives.

Loops over lanes are left to LLVM; where one ray meets many primitives there is no such loop, and vectors are explicit.
They take the operators of plain numbers (a plain number beside one is eight copies), so a formula written once, such as
`triangle_distance`, serves both and gives the same bits. Nothing here depends on the processor: LLVM splits or
joins the vectors as it has registers. `select`, `fma` and `const` of `values` take these as well as scalars.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import signature as nb_signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin

from engines.kernels.compile.memory import tag_access
from engines.kernels.compile.processor import has_feature
from engines.kernels.compile.simd_types import WIDTH, Mask, Simd, call_vector, constants, shuffled, spread
from engines.kernels.compile.weak_literals import WeakFloat

# ---- operators -------------------------------------------------------------------------------------------------------


_PLAIN = (types.Float, types.Integer, WeakFloat)


def _kind(a: Any, b: Any) -> Any:
    """The scalar type of an operation with a vector; None where none takes part, or two of different types."""
    kinds = {x.kind for x in (a, b) if isinstance(x, Simd)}
    plain = all(isinstance(x, (Simd, *_PLAIN)) for x in (a, b))
    return kinds.pop() if len(kinds) == 1 and plain else None


def _operands(context: Any, builder: Any, signature: Any, arguments: Any, kind: Any) -> list[Any]:
    """Both as vectors of `kind`."""
    return [
        spread(builder, x if isinstance(given, Simd) else context.cast(builder, x, given, kind))
        for x, given in zip(arguments, signature.args, strict=True)
    ]


def _give(function: Any, result: Callable[[Any, Any], Any], apply: Callable[..., Any], operands: Any) -> None:
    """Teaches `function` of two: its type result(a, b), None where it does not apply, and its instruction
    apply(builder, kind, a, b). Numba's `overload` would compile a function for every pair of types instead."""

    @infer_global(function)
    class _(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            kind = None if kws or len(args) != 2 else result(*args)
            return None if kind is None else nb_signature(kind, *args)

    for pair in operands:

        @lower_builtin(function, *pair)
        def lowered(context, builder, signature, arguments):
            kind = _kind(*signature.args)
            if kind is not None:
                arguments = _operands(context, builder, signature, arguments, kind)
            return apply(builder, kind, *arguments)


_WITH_VECTOR = ((Simd, Simd), *((Simd, one) for one in _PLAIN), *((one, Simd) for one in _PLAIN))


def _instruction(name: str) -> Any:
    return lambda builder, kind, a, b: getattr(builder, name)(a, b)


def _compare(sign: str) -> Any:
    return lambda builder, kind, a, b: (builder.fcmp_ordered if isinstance(kind, types.Float) else builder.icmp_signed)(
        sign, a, b
    )


def _vector_of(scalar: Any) -> Any:
    """The result of arithmetic on vectors of floats, or of integers."""

    def result(a: Any, b: Any) -> Any:
        kind = _kind(a, b)
        return Simd(kind) if isinstance(kind, scalar) else None

    return result


def _both_masks(a: Any, b: Any) -> Any:
    return Mask() if isinstance(a, Mask) and isinstance(b, Mask) else None


def _mask_of_vectors(a: Any, b: Any) -> Any:
    return None if _kind(a, b) is None else Mask()


for _function, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _give(_function, _vector_of(types.Float), _instruction(_name), _WITH_VECTOR)
for _function, _name in ((operator.and_, "and_"), (operator.or_, "or_")):
    _give(_function, _vector_of(types.Integer), _instruction(_name), _WITH_VECTOR)
    _give(_function, _both_masks, _instruction(_name), ((Mask, Mask),))
for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _give(_function, _mask_of_vectors, _compare(_sign), _WITH_VECTOR)


def _give_one(function: Any, apply: Callable[[Any, Any], Any]) -> None:
    """Teaches a function of one number to take a vector."""

    @infer_global(function)
    class _(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            return nb_signature(args[0], args[0]) if isinstance(args[0], Simd) else None

    @lower_builtin(function, Simd)
    def lowered(context, builder, signature, arguments):
        return apply(builder, arguments[0])


_give_one(operator.neg, lambda builder, a: builder.fneg(a))
_give_one(abs, lambda builder, a: call_vector(builder, "fabs", [a]))
_give_one(math.sqrt, lambda builder, a: call_vector(builder, "sqrt", [a]))


@intrinsic
def lesser(typing, a, b):
    """The lesser of each pair of floats, none of them NaN. Where one comes from memory and the result goes back there, LLVM
    would make a masked store of `select`, which doubled the time of a build on Zen 3."""

    def generate(context, builder, signature, arguments):
        return call_vector(builder, "minnum", arguments, ("nnan", "nsz"))

    return a(a, b), generate


# ---- other types -----------------------------------------------------------------------------------------------------


@intrinsic
def convert(typing, a, kind):
    """Each number in the scalar type `kind`: floats rounded to nearest among floats, towards zero to integers."""
    target = kind.dtype

    def generate(context, builder, signature, arguments):
        vector = context.get_value_type(signature.return_type)
        if a.kind == target:
            return arguments[0]
        if isinstance(target, types.Integer):
            return builder.fptosi(arguments[0], vector)
        narrower = target.bitwidth < a.kind.bitwidth
        return (builder.fptrunc if narrower else builder.fpext)(arguments[0], vector)

    return Simd(target)(a, kind), generate


@intrinsic
def as_bits(typing, a, kind):
    """The same bits as numbers of the scalar type `kind`, of equal width."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return Simd(kind.dtype)(a, kind), generate


@intrinsic
def splat(typing, x):
    """Eight copies of a number."""

    def generate(context, builder, signature, arguments):
        return spread(builder, arguments[0])

    return Simd(x)(x), generate


@intrinsic
def iota(typing):
    """0 .. 7 in int32."""

    def generate(context, builder, signature, arguments):
        return constants(range(WIDTH))

    return Simd(types.int32)(), generate


@intrinsic
def bits(typing, mask):
    """A word whose lowest eight bits are the truth values."""

    def generate(context, builder, signature, arguments):
        return builder.zext(builder.bitcast(arguments[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.int64(mask), generate


# ---- among the eight -------------------------------------------------------------------------------------------------


@intrinsic
def lane(typing, a, k):
    """Number k of the eight."""

    def generate(context, builder, signature, arguments):
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], ir.IntType(32)))

    return a.kind(a, types.int64), generate


@intrinsic
def swapped(typing, a):
    """The second four, then the first four."""

    def generate(context, builder, signature, arguments):
        return shuffled(builder, arguments[0], [*range(WIDTH // 2, WIDTH), *range(WIDTH // 2)])

    return a(a), generate


def _larger(builder: Any, kind: Any, x: Any, y: Any) -> Any:
    return builder.fcmp_ordered(">", x, y) if isinstance(kind, types.Float) else builder.icmp_signed(">", x, y)


@intrinsic
def lowest(typing, a):
    """The least of the eight, none of them NaN."""

    def generate(context, builder, signature, arguments):
        value, width = arguments[0], WIDTH
        while width > 1:
            width //= 2
            x, y = shuffled(builder, value, range(width)), shuffled(builder, value, range(width, 2 * width))
            value = builder.select(_larger(builder, a.kind, x, y), y, x)
        return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))

    return a.kind(a), generate


@intrinsic
def packed(typing, a, mask):
    """The int32 numbers that the mask holds, in their order, and behind them any others."""

    def generate(context, builder, signature, arguments):
        numbers, held = arguments
        if has_feature("avx2") and not has_feature("avx512vl"):
            kind = ir.FunctionType(numbers.type, [numbers.type, numbers.type])
            permute = builder.module.declare_intrinsic("llvm.x86.avx2.permd", (), kind)
            return builder.call(permute, [numbers, _places_held(builder, held)])
        kind = ir.FunctionType(numbers.type, [numbers.type, held.type, numbers.type])
        compress = builder.module.declare_intrinsic("llvm.experimental.vector.compress.v8i32", (), kind)
        return builder.call(compress, [numbers, held, ir.Constant(numbers.type, ir.Undefined)])

    return a(a, mask), generate


def _places_held(builder: Any, held: Any) -> Any:
    """Where the numbers lie that a mask holds, from a table of all masks: AVX2 cannot compress."""
    masks = [[k for k in range(WIDTH) if mask >> k & 1] for mask in range(2**WIDTH)]
    rows = ir.VectorType(ir.IntType(8), WIDTH)
    places = ir.Constant(ir.ArrayType(rows, len(masks)), [ir.Constant(rows, [*m, *[0] * (WIDTH - len(m))]) for m in masks])
    table = cgutils.global_constant(builder, "places_held", places)
    word = ir.IntType(64)
    row = builder.gep(table, [ir.Constant(word, 0), builder.zext(builder.bitcast(held, ir.IntType(WIDTH)), word)])
    return builder.zext(builder.load(row), ir.VectorType(ir.IntType(32), WIDTH))


# ---- memory ----------------------------------------------------------------------------------------------------------


def _place(context: Any, builder: Any, array: Any, arguments: Any) -> Any:
    address = builder.gep(arguments[0], [arguments[1]])
    return builder.bitcast(address, context.get_value_type(Simd(array.dtype)).as_pointer())


@intrinsic
def load8(typing, array, index):
    """`array[index : index + 8]` of an array that is not a ray batch; no alignment is needed."""

    def generate(context, builder, signature, arguments):
        place = _place(context, builder, array, arguments)
        value = builder.load(place, align=array.dtype.bitwidth // 8)
        tag_access(builder.module, value, False)
        return value

    return Simd(array.dtype)(array, types.int64), generate


@intrinsic
def store8(typing, array, index, value):
    """Writes `array[index : index + 8]`."""

    def generate(context, builder, signature, arguments):
        place = _place(context, builder, array, arguments)
        tag_access(builder.module, builder.store(arguments[2], place, align=array.dtype.bitwidth // 8), False)
        return context.get_dummy_value()

    return types.void(array, types.int64, Simd(array.dtype)), generate
