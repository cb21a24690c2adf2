"""Numba's types for eight numbers, and for eight truth values, and how LLVM calls them; what they can do is in `simd`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.datamodel import models
from numba.extending import register_model

WIDTH = 8


class Simd(types.Type):
    """Eight numbers of the scalar type `kind`."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        super().__init__(name=f"Simd({kind})")


class Mask(types.Type):
    """Eight truth values."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


@register_model(Simd)
class _SimdModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(manager.lookup(kind.kind).get_value_type(), WIDTH))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), WIDTH))


def constants(values: Sequence[int]) -> Any:
    """A vector of int32 constants."""
    return ir.Constant(ir.VectorType(ir.IntType(32), len(values)), list(values))


def shuffled(builder: Any, value: Any, places: Sequence[int]) -> Any:
    return builder.shuffle_vector(value, value, constants(places))


def spread(builder: Any, value: Any) -> Any:
    """Eight copies of a number; a vector as it is."""
    if isinstance(value.type, ir.VectorType):
        return value
    empty = ir.Constant(ir.VectorType(value.type, WIDTH), ir.Undefined)
    return shuffled(builder, builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0)), [0] * WIDTH)


def call_vector(builder: Any, name: str, values: Sequence[Any], fastmath: Sequence[str] = ()) -> Any:
    """Calls LLVM's floating-point intrinsic `name` on vectors of one type, such as `fma`."""
    kind = values[0].type
    full = f"llvm.{name}.v{WIDTH}f{32 if isinstance(kind.element, ir.FloatType) else 64}"
    found = builder.module.globals.get(full)
    if found is None:
        found = ir.Function(builder.module, ir.FunctionType(kind, [kind] * len(values)), full)
    return builder.call(found, values, fastmath=fastmath)
