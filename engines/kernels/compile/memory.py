"""Memory of kernels: arrays by address, and what is known of their overlap.

A ray batch (written) and everything else (the scene, read; scratch) never overlap. Saying so on each access is what
lets LLVM vectorise loops that gather from the scene while they write the batch.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

WORD = ir.IntType(64)


class ArrayType(types.Type):
    """Numbers of the scalar type `dtype` in a row: no bounds are checked. `array[i]` and `array[i] = value`."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Array({dtype})")


@register_model(ArrayType)
class _ArrayModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.dtype).get_value_type().as_pointer())


def tag_access(module: Any, access: Any, of_batch: bool) -> None:
    """Notes on a load or store whether it is one of a ray batch."""
    domain = module.add_metadata([ir.MetaDataString(module, "raybench")])
    batch = module.add_metadata([module.add_metadata([ir.MetaDataString(module, "batch"), domain])])
    others = module.add_metadata([module.add_metadata([ir.MetaDataString(module, "others"), domain])])
    access.set_metadata("alias.scope", batch if of_batch else others)
    access.set_metadata("noalias", others if of_batch else batch)


def load(builder: Any, place: Any, of_batch: bool = False) -> Any:
    """The value at the pointer `place`."""
    value = builder.load(place)
    tag_access(builder.module, value, of_batch)
    return value


def store(builder: Any, value: Any, place: Any, of_batch: bool = False) -> None:
    tag_access(builder.module, builder.store(value, place), of_batch)


def index_word(context: Any, builder: Any, index: Any, kind: Any) -> Any:
    """An index of any integer type in 64 bits."""
    return context.cast(builder, index, kind, types.int64)


def teach_items(kind: type, item: Any, get: Any, put: Any = None) -> None:
    """Teaches compiled code `x[i]`, and with `put` `x[i] = value`, of values of the Numba type `kind`.

    `item(type, index type)` is the type of what lies there, None where such an index is none. `get(context, builder, type,
    value, index)`, the last a list of 64-bit words, loads it; `put(..., item, its type)` stores it.
    """

    def words(context: Any, builder: Any, index: Any, index_type: Any) -> list[Any]:
        if isinstance(index_type, types.Integer):
            return [index_word(context, builder, index, index_type)]
        parts = [builder.extract_value(index, k) for k in range(len(index_type))]
        return [index_word(context, builder, part, of) for part, of in zip(parts, index_type, strict=True)]

    @infer_global(operator.getitem)
    class _(AbstractTemplate):
        key = operator.getitem

        def generic(self, args: Any, kws: Any) -> Any:
            if not isinstance(args[0], kind) or not _is_index(args[1]):
                return None
            found = item(args[0], args[1])
            return None if found is None else signature(found, *args)

    for index_kind in (types.Integer, types.BaseTuple):

        @lower_builtin(operator.getitem, kind, index_kind)
        def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return get(context, builder, sig.args[0], args[0], words(context, builder, args[1], sig.args[1]))

    if put is None:
        return

    @infer_global(operator.setitem)
    class _Put(AbstractTemplate):
        key = operator.setitem

        def generic(self, args: Any, kws: Any) -> Any:
            if not isinstance(args[0], kind) or not _is_index(args[1]):
                return None
            return None if item(args[0], args[1]) is None else signature(types.none, *args)

    for index_kind in (types.Integer, types.BaseTuple):

        @lower_builtin(operator.setitem, kind, index_kind, types.Any)
        def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            place = words(context, builder, args[1], sig.args[1])
            put(context, builder, sig.args[0], args[0], place, args[2], sig.args[2])
            return context.get_dummy_value()


def _is_index(kind: Any) -> bool:
    if isinstance(kind, types.BaseTuple):
        return all(isinstance(part, types.Integer) for part in kind)
    return isinstance(kind, types.Integer)


def _get_number(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    return load(builder, builder.gep(array, index))


def _put_number(context: Any, builder: Any, kind: Any, array: Any, index: Any, value: Any, of: Any) -> None:
    store(builder, context.cast(builder, value, of, kind.dtype), builder.gep(array, index))


teach_items(ArrayType, lambda kind, index: kind.dtype if isinstance(index, types.Integer) else None, _get_number, _put_number)


@intrinsic
def array_at(typing, address, kind):
    """The array of the scalar type `kind`, such as np.float32, at an address."""

    def generate(context, builder, sig, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(sig.return_type))

    return ArrayType(kind.dtype)(types.int64, kind), generate


@intrinsic
def address_of(typing, array):
    """The address at which an array, or a row, begins."""

    def generate(context, builder, sig, arguments):
        return builder.ptrtoint(arguments[0], WORD)

    return types.int64(array), generate


@intrinsic
def prefetch(typing, address):
    """Starts loading the cache line at `address` and does not wait for it."""

    def generate(context, builder, signature, arguments):
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        name, kind = "llvm.prefetch.p0", ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        found = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        builder.call(found, [builder.inttoptr(arguments[0], byte), *(ir.Constant(word, k) for k in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(types.int64), generate
