"""Float literals that take the type of what they meet: `2.0 * x` is float32 where x is.

Numba reads a bare literal as float64, and so would turn float32 arithmetic into float64. A pass over Numba's untyped code makes
each float constant (a literal, `math.pi`, a global) one of the type `WeakFloat`, which every float type may take. Constants
among themselves are computed in float64, as Python does. A number that a factory closes over has a type already.
"""

from __future__ import annotations

import math
import operator
from types import ModuleType
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.errors import TypingError
from numba.core.imputils import lower_constant
from numba.core.typeconv.rules import default_casting_rules
from numba.core.typed_passes import NopythonTypeInference
from numba.core.untyped_passes import IRProcessing
from numba.extending import box, intrinsic, lower_cast, models, register_model, typeof_impl


class Weak(float):
    """The value of a weak literal. As a global number, or in a global record, it is weak in compiled code, too."""


class WeakFloat(types.Type):
    """The type of a weak literal, in whose place stands that of a float beside it."""

    def __init__(self) -> None:
        super().__init__("weak float")

    def unify(self, context: Any, other: Any) -> Any:
        return other if isinstance(other, types.Float) else None


WEAK = WeakFloat()
default_casting_rules.promote(WEAK, types.float32)
typeof_impl.register(Weak)(lambda value, context: WEAK)


@register_model(WeakFloat)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, llvm.DoubleType())


@lower_cast(WeakFloat, types.Float)
def _cast(context: Any, builder: Any, of: Any, to: Any, value: Any) -> Any:
    return context.cast(builder, value, types.float64, to)


def _first_float(like: Any) -> Any:
    if not isinstance(like, types.BaseTuple):
        return like
    kinds = (_first_float(part) for part in like)
    return next((kind for kind in kinds if isinstance(kind, types.Float)), types.float64)


@intrinsic
def const(typing, value, like):
    """The number `value` in the type of `like`, a number, some (`simd`), or a record, of which the first float counts."""
    kind = getattr(like, "kind", _first_float(like))

    def generate(context, builder, signature, arguments):
        return context.cast(builder, arguments[0], signature.args[0], kind)

    return kind(value, like), generate


@box(WeakFloat)
def _boxed(kind: Any, value: Any, c: Any) -> Any:
    return c.pyapi.float_from_double(value)


@lower_constant(WeakFloat)
def _constant(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_constant(types.float64, float(value))


_FUNCTIONS = [function for function in vars(math).values() if callable(function)]
_FOLDED = {operator.add, operator.sub, operator.mul, operator.truediv, operator.pow}


def _value(right: Any, known: dict[str, Any]) -> Any:
    """The value of the right side of an assignment where it is a constant, a module or an attribute of one; else None."""
    if isinstance(right, (ir.Const, ir.Global)) or (isinstance(right, ir.FreeVar) and type(right.value) is not float):
        return right.value
    if not isinstance(right, ir.Expr):
        return None
    if right.op == "getattr" and isinstance(known.get(right.value.name), ModuleType):
        return getattr(known[right.value.name], right.attr, None)
    if right.op == "call" and known.get(right.func.name) in _FUNCTIONS:
        return _folded(known[right.func.name], *(known.get(part.name) for part in right.args))
    if right.op == "unary" and right.fn is operator.neg:
        return _folded(operator.neg, known.get(right.value.name))
    if right.op == "binop" and right.fn in _FOLDED:
        return _folded(right.fn, known.get(right.lhs.name), known.get(right.rhs.name))
    return None


def _folded(function: Any, *values: Any) -> Any:
    """The function of literals, None where one is no literal or Python has no value."""
    try:
        return function(*values) if all(map(_is_float, values)) else None
    except (ArithmeticError, ValueError):
        return None


def _is_float(value: Any) -> bool:
    return type(value) is float


def _may_be_type(value: Any) -> bool:
    """Whether what is called is a type of numbers, as far as one knows: `real` is a parameter of many functions."""
    return value is None or (isinstance(value, type) and issubclass(value, (float, np.number)))


@register_pass(mutates_CFG=False, analysis_only=False)
class WeakLiterals(FunctionPass):
    _name = "raybench_weak_literals"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        known: dict[str, Any] = {}
        for block in state.func_ir.blocks.values():
            known = {name: value for name, value in known.items() if name.startswith("$")}  # assigned once
            literals: dict[str, ir.Assign] = {}
            body, block.body = block.body, []
            for statement in body:
                if isinstance(statement, ir.Assign):
                    right = statement.value
                    value = known[statement.target.name] = _value(right, known)
                    if _is_float(value):
                        literals[statement.target.name] = statement
                        statement.value = ir.Const(Weak(value), statement.loc)
                    elif isinstance(right, ir.Expr) and right.op == "call":
                        _type_arguments(block, statement, known.get(right.func.name), literals)
                block.body.append(statement)
        return True


def _type_arguments(block: Any, call: ir.Assign, function: Any, literals: dict[str, ir.Assign]) -> None:
    """Literals among the arguments of a call get a type where Numba would find none: in a record, such as a vector, that of its
    first other float, and float64 where there is none; float64 for a type of numbers, and for a parameter, which may be one."""
    every = [*call.value.args, *(part for _, part in call.value.kws)]
    given = [part for part in every if part.name in literals]
    others = [part for part in every if part.name not in literals]
    is_record = isinstance(function, type) and issubclass(function, tuple)
    if is_record and given and others:
        like = _assigned(block, "like", ir.Expr.build_tuple(others, call.loc), call)
        typed = _assigned(block, "const", ir.Global("const", const, call.loc), call)
        for part in given:
            value = _assigned(block, part.name, ir.Expr.call(typed, (part, like), (), call.loc), call)
            call.value.args = [value if each is part else each for each in call.value.args]
            call.value.kws = [(name, value if each is part else each) for name, each in call.value.kws]
    elif is_record or _may_be_type(function):
        for part in given:
            literals[part.name].value = ir.Const(float(literals[part.name].value.value), call.loc)


def _assigned(block: Any, name: str, value: Any, call: ir.Assign) -> ir.Var:
    """A variable of that value, before the call."""
    variable = ir.Var(block.scope, f"{call.target.name}.{name}", call.loc)
    block.body.append(ir.Assign(value, variable, call.loc))
    return variable


@register_pass(mutates_CFG=False, analysis_only=True)
class NoLiteralPairs(FunctionPass):
    """Refuses arithmetic of literals that only meet at run time, which Numba would do in float32."""

    _name = "raybench_no_literal_pairs"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        for expression in state.calltypes:
            if not isinstance(expression, ir.Expr) or expression.op not in ("binop", "inplace_binop", "call"):
                continue
            parts = expression.args if expression.op == "call" else (expression.lhs, expression.rhs)
            ours = expression.op == "call" and not isinstance(state.typemap[expression.func.name], types.Function)
            if not ours and parts and {state.typemap[part.name] for part in parts} == {WEAK}:
                raise TypingError("all operands are float literals: give one of them a type", expression.loc)
        return False


class WeakCompiler(CompilerBase):
    """Numba's compiler with the pass."""

    def define_pipelines(self) -> list[Any]:
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.add_pass_after(WeakLiterals, IRProcessing)
        manager.add_pass_after(NoLiteralPairs, NopythonTypeInference)
        manager.finalize()
        return [manager]
