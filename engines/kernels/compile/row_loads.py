"""Rows of a table into the lanes of a batch: a few numbers of one row a lane, loaded as vectors and transposed. Stored one by
one they cost most of a stage, and vector loads behind such stores wait for all of them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from engines.kernels.compile.fields import LANES, REAL, scalar_type_of, word_of
from engines.kernels.compile.memory import WORD, load, tag_access

AT_ONCE = 4
"""Numbers that one vector load takes of a row, at most."""


def _shuffle(builder: Any, one: Any, two: Any, places: list[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)
    return builder.shuffle_vector(one, two, mask)


def _joined(builder: Any, parts: list[Any]) -> Any:
    """One vector of four parts."""
    width = parts[0].type.count
    two = [_shuffle(builder, parts[k], parts[k + 1], list(range(2 * width))) for k in (0, 2)]
    return _shuffle(builder, *two, list(range(4 * width)))


def _interleaved(builder: Any, one: Any, two: Any, places: tuple[int, ...]) -> Any:
    """Of every four numbers of both vectors those at `places`: 0 to 3 of the first, 4 to 7 of the second."""
    every = [
        first + (place if place < AT_ONCE else LANES + place - AT_ONCE)
        for first in range(0, LANES, AT_ONCE)
        for place in places
    ]
    return _shuffle(builder, one, two, every)


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Sixteen rows of four numbers as four vectors of sixteen lanes."""
    quarters = [_joined(builder, rows[k::4]) for k in range(4)]
    low = [_interleaved(builder, quarters[k], quarters[k + 1], (0, 4, 1, 5)) for k in (0, 2)]
    high = [_interleaved(builder, quarters[k], quarters[k + 1], (2, 6, 3, 7)) for k in (0, 2)]
    return [_interleaved(builder, *pair, places) for pair in (low, high) for places in ((0, 1, 4, 5), (2, 3, 6, 7))]


@cache
def row_loads(index: int, stride: int, columns: tuple[int, ...], targets: tuple[int, ...], dtype: Any = REAL) -> Any:
    """The function of compiled code (rays, address, lanes) that copies numbers of a row of each lane of the word `lanes`, those
    at `columns`: consecutive, and at most four. A row is `stride` numbers of `dtype`: the batch's scalar type, np.int32 or
    np.float64; the rows begin at the address. The integer field at number `index` of a lane holds the lane's row index, which
    must be valid in every lane. `targets` are the numbers of a lane at which the copies begin; a copy of a whole number is an
    integer field, and one of float64 takes two numbers of a batch of float32."""

    @intrinsic
    def copy_columns(typing, rays, address, lanes):
        def generate(context, builder, signature, arguments):
            base, start, wanted = arguments
            of = scalar_type_of(dtype, rays.real)
            size, word = of.bitwidth // 8, context.get_value_type(word_of(rays.real))
            kind = ir.VectorType(context.get_value_type(of), len(columns))
            rows = []
            for lane in range(LANES):
                place = builder.gep(base, [ir.Constant(WORD, index * LANES + lane)])
                row = load(builder, builder.bitcast(place, word.as_pointer()), True)
                row = builder.sext(row, WORD) if word.width < WORD.width else row
                offset = builder.mul(row, ir.Constant(WORD, stride * size))
                offset = builder.add(offset, ir.Constant(WORD, columns[0] * size))
                value = builder.load(builder.inttoptr(builder.add(start, offset), kind.as_pointer()), align=size)
                tag_access(builder.module, value, False)
                whole = [k if k < len(columns) else 0 for k in range(AT_ONCE)]
                rows.append(_shuffle(builder, value, value, whole))
            mask = builder.bitcast(builder.trunc(wanted, ir.IntType(LANES)), ir.VectorType(ir.IntType(1), LANES))
            for number, column in zip(targets, _transposed(builder, rows), strict=False):
                value = builder.sext(column, ir.VectorType(word, LANES)) if dtype is np.int32 else column
                place = builder.gep(base, [ir.Constant(WORD, number * LANES)])
                place = builder.bitcast(place, value.type.as_pointer())
                before = builder.load(place, align=size)
                tag_access(builder.module, before, True)
                stored = builder.store(builder.select(mask, value, before), place, align=size)
                tag_access(builder.module, stored, True)
            return context.get_dummy_value()

        return types.void(rays, types.int64, types.int64), generate

    return copy_columns
