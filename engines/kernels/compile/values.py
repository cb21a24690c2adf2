"""Operations on numbers that compiled code has and Python lacks: selection without a branch, fused multiply-add,
constants of a given type, bits of words, and calls through function pointers. `select`, `fma` and `const` take vectors
(`simd`) as well."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from engines.kernels.compile.simd_types import Simd, call_vector, spread
from engines.kernels.compile.weak_literals import WeakFloat, const

# ---- calls and atomics -----------------------------------------------------------------------------------------------


@intrinsic
def call_stage(typing, stage, batch, scene):
    """Calls the stage at address `stage`."""

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


@intrinsic
def keep_scalar(typing):
    """Keeps LLVM from making vector code of the loop around it: gathers of a few numbers per lane cost more than they save."""

    def generate(context, builder, signature, arguments):
        nothing = ir.FunctionType(ir.VoidType(), [])
        builder.call(ir.InlineAsm(nothing, "", "", side_effect=True), [])
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def call_function(typing, function, arguments):
    """Calls the C function at address `function`, which returns nothing, with a tuple of 64-bit arguments."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * len(arguments))
        words = [builder.extract_value(values[1], k) for k in range(len(arguments))]
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), words)
        return context.get_dummy_value()

    return types.void(types.int64, types.UniTuple(types.int64, len(arguments))), generate


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


def _type_of_both(yes: Any, no: Any) -> Any:
    """The type of a value that is one of two: a literal has that of the other, and a plain number beside a vector is eight."""
    if isinstance(yes, types.BaseTuple) and isinstance(no, types.BaseTuple) and len(yes) == len(no):
        parts = [_type_of_both(*pair) for pair in zip(yes, no, strict=True)]
        return types.BaseTuple.from_types(parts, getattr(yes, "instance_class", None))
    return no if isinstance(no, Simd) or isinstance(yes, WeakFloat) else yes


def _select(context: Any, builder: Any, condition: Any, kind: Any, values: Any, kinds: Any) -> Any:
    if isinstance(kind, types.BaseTuple):
        parts = [
            _select(context, builder, condition, part, [builder.extract_value(value, k) for value in values], pair)
            for k, (part, *pair) in enumerate(zip(kind, *kinds, strict=True))
        ]
        return context.make_tuple(builder, kind, parts)
    if kind == types.none:
        return context.get_dummy_value()
    scalar = kind.kind if isinstance(kind, Simd) else kind
    values = [
        value if isinstance(of, Simd) else context.cast(builder, value, of, scalar)
        for value, of in zip(values, kinds, strict=True)
    ]
    return builder.select(condition, *(spread(builder, value) if isinstance(kind, Simd) else value for value in values))


@intrinsic
def select(typing, condition, yes, no):
    """`yes` where `condition` holds, else `no`, both evaluated: never a branch, so loops over lanes stay vector code. Takes
    numbers, and records part by part. Of a mask (`simd`) it selects number by number, and a plain number is eight equal
    ones."""
    result = _type_of_both(yes, no)

    def generate(context, builder, signature, arguments):
        return _select(context, builder, arguments[0], result, arguments[1:], signature.args[1:])

    return result(condition, yes, no), generate


@intrinsic
def pick(typing, condition, yes, no):
    """`select` of 64-bit integers for scalar loops, in which LLVM makes branches of selects: one by chance is mispredicted."""

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        as_it_is = ir.InlineAsm(ir.FunctionType(word, [word]), "", "=r,0", side_effect=False)
        mask = builder.call(as_it_is, [builder.sext(arguments[0], word)])
        return builder.xor(arguments[2], builder.and_(builder.xor(arguments[1], arguments[2]), mask))

    return types.int64(types.boolean, types.int64, types.int64), generate


@intrinsic
def fma(typing, a, b, c):
    """a b + c, rounded once."""
    kind = _type_of_both(_type_of_both(a, b), c)

    def generate(context, builder, signature, arguments):
        if isinstance(kind, Simd):
            return call_vector(builder, "fma", arguments)
        return builder.fma(*(context.cast(builder, x, of, kind) for x, of in zip(arguments, signature.args, strict=True)))

    return kind(a, b, c), generate


def _take_literals(function: Any) -> None:
    """Teaches `min` or `max` to take a literal beside a number."""

    @overload(function)
    def of_two(a, b):
        if isinstance(b, WeakFloat) and isinstance(a, types.Float):
            return lambda a, b: function(a, const(b, a))
        if isinstance(a, WeakFloat) and isinstance(b, types.Float):
            return lambda a, b: function(const(a, b), b)
        return None


_take_literals(min)
_take_literals(max)


# ---- powers of two ---------------------------------------------------------------------------------------------------


def _format(kind: types.Float) -> tuple[ir.IntType, int, int]:
    """Of a floating-point type: integers of its width, bits of the mantissa, bias of the exponent."""
    return (ir.IntType(32), 23, 127) if kind == types.float32 else (ir.IntType(64), 52, 1023)


@intrinsic
def power_of_two(typing, n):
    """2^n of a whole number n, in the range of normal numbers. Vector code, which a conversion to integers is not."""
    word, mantissa, bias = _format(n)

    def generate(context, builder, signature, arguments):
        kind = arguments[0].type
        # in [2^mantissa, 2^(mantissa + 1)) the last bits of a number are the whole number that it exceeds 2^mantissa by
        moved = builder.fadd(arguments[0], ir.Constant(kind, float(2**mantissa + bias)))
        return builder.bitcast(builder.shl(builder.bitcast(moved, word), ir.Constant(word, mantissa)), kind)

    return n(n), generate


@intrinsic
def exponent_of(typing, x):
    """The whole number e with 2^e <= x < 2^(e + 1), in the type of x: positive, normal and finite."""
    word, mantissa, bias = _format(x)

    def generate(context, builder, signature, arguments):
        kind = arguments[0].type
        biased = builder.lshr(builder.bitcast(arguments[0], word), ir.Constant(word, mantissa))
        moved = builder.bitcast(builder.or_(biased, ir.Constant(word, (bias + mantissa) << mantissa)), kind)
        return builder.fsub(moved, ir.Constant(kind, float(2**mantissa + bias)))

    return x(x), generate


@intrinsic
def mantissa_of(typing, x):
    """x 2^-e in [1, 2), e the `exponent_of` x."""
    word, mantissa, bias = _format(x)

    def generate(context, builder, signature, arguments):
        bits = builder.and_(builder.bitcast(arguments[0], word), ir.Constant(word, (1 << mantissa) - 1))
        return builder.bitcast(builder.or_(bits, ir.Constant(word, bias << mantissa)), arguments[0].type)

    return x(x), generate


def polynomial(*coefficients: float) -> Any:
    """The function of compiled code x -> coefficients[0] + coefficients[1] x + ..., in the type of x, by Horner's rule."""

    @intrinsic
    def evaluate(typing, x):
        def generate(context, builder, signature, arguments):
            kind = arguments[0].type
            total = ir.Constant(kind, coefficients[-1])
            for coefficient in coefficients[-2::-1]:
                total = builder.fadd(builder.fmul(total, arguments[0]), ir.Constant(kind, coefficient))
            return total

        return x(x), generate

    return evaluate
