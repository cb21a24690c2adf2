"""Named fields in memory: what compiled code stores and loads by name is what NumPy sees at that place."""

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from engines.kernels.compile.jit import OPTIONS
from engines.kernels.compile.records import (
    LANES,
    REAL,
    LaneRecord,
    Row,
    Table,
    array,
    bits_of,
    doubles,
    flag,
    integer,
    lane_view,
    real,
    reals,
    rows,
    scalar,
    table_view,
    vector,
    vectors,
)
from engines.kernels.compile.vec3 import Vec3

PRECISIONS = pytest.mark.parametrize("kind", [np.float32, np.float64])
WORD = {np.float32: np.int32, np.float64: np.int64}


class Sample(LaneRecord):
    t = real()
    point = vector()
    primitive = integer()
    hit = flag()
    draw = reals(2)
    draw_bits = bits_of(draw)
    exact = doubles(2)
    after = real()


class BoxRow(Row):
    size = real()
    low = vector()
    weights = reals(2)


class FaceRow(Row):
    dtype = np.int32
    a = real()
    b = real()


class Things(Table, first=2):
    n = scalar()
    numbers = array(REAL)
    ids = array(np.int32)
    points = vectors(np.float64)
    boxes = rows(BoxRow)
    faces = rows(FaceRow)


samples, things = lane_view(Sample), table_view(Things)


def memory(kind, records=1):
    """Room for records of sixteen lanes, and its numbers by [record, number, lane]."""
    buffer = np.zeros(records * Sample.bytes(kind), np.uint8)
    return buffer.ctypes.data, buffer.view(kind).reshape(records, Sample.size, LANES)


@numba.njit(**OPTIONS)
def store_all(address, kind):
    record = samples(address, kind)
    for lane in range(LANES):
        record.t[lane] = lane + 0.5
        record.point[lane] = Vec3(kind(lane), kind(2 * lane), kind(3 * lane))
        record.primitive[lane] = lane - 3
        record.hit[lane] = lane % 3 == 0
        record.draw[0, lane] = 0.25
        record.draw_bits[1, lane] = 1000 + lane
        record.exact[0, lane] = 1.0 / 3.0
        record.exact[1, lane] = lane / 7.0
        record.after[lane] = -lane


@numba.njit(**OPTIONS)
def load_all(address, kind, found):
    record = samples(address, kind)
    for lane in range(LANES):
        p = record.point[lane]
        found[lane, 0], found[lane, 1], found[lane, 2], found[lane, 3] = record.t[lane], p.x, p.y, p.z
        found[lane, 4], found[lane, 5] = record.primitive[lane], 1.0 if record.hit[lane] else 0.0
        found[lane, 6], found[lane, 7] = record.draw[0, lane], record.draw_bits[1, lane]
        found[lane, 8], found[lane, 9], found[lane, 10] = (record.exact[0, lane], record.exact[1, lane], record.after[lane])


@PRECISIONS
def test_every_kind_of_field_is_stored_and_loaded(kind):
    (address, numbers), found, lane = memory(kind), np.zeros((LANES, 11)), np.arange(LANES)
    store_all(address, kind)
    load_all(address, kind, found)
    expected = [lane + 0.5, lane, 2 * lane, 3 * lane, lane - 3, lane % 3 == 0, 0.25, 1000 + lane, 1 / 3, lane / 7, -lane]
    assert found.tolist() == np.column_stack([np.broadcast_to(x, LANES) for x in expected]).tolist()
    assert numbers[0, 0].tolist() == (lane + 0.5).tolist(), "a field is sixteen numbers in a row"
    assert numbers[0, 1:4].tolist() == [lane.tolist(), (2 * lane).tolist(), (3 * lane).tolist()]
    assert numbers[0, 4].view(WORD[kind]).tolist() == (lane - 3).tolist(), "an integer keeps its bits"
    assert numbers[0, 7].view(WORD[kind]).tolist() == (1000 + lane).tolist(), "an overlay shares its field's memory"
    assert numbers[0, -1].tolist() == (-lane).tolist()


def test_a_layout_has_no_gaps_and_an_overlay_takes_no_room():
    assert {name: field.first for name, field in Sample.fields.items()} == {
        "t": 0,
        "point": 1,
        "primitive": 4,
        "hit": 5,
        "draw": 6,
        "draw_bits": 6,
        "exact": 8,
        "after": 12,
    }
    assert Sample.size == 13
    assert Sample.bytes(np.float32) == 13 * LANES * 4


@numba.njit(**OPTIONS)
def store_second(address, kind):
    samples(address, kind)[1].t[5] = 7.0


@PRECISIONS
def test_memory_may_hold_several_records(kind):
    address, numbers = memory(kind, records=3)
    store_second(address, kind)
    assert np.argwhere(numbers).tolist() == [[1, 0, 5]]
    assert numbers[1, 0, 5] == 7


@numba.njit(**OPTIONS)
def load_table(address, kind, found):
    table = things(address, kind)
    point, box, face = table.points[1], table.boxes[2], table.faces[1]
    found[0], found[1], found[2] = table.n, table.numbers[3], table.ids[2]
    found[3], found[4], found[5] = point.x, point.y, point.z
    found[6], found[7], found[8] = box.size, box.low.z, box.weights[1]
    found[9], found[10] = face.a, face.b


@PRECISIONS
def test_a_table_leads_to_numbers_vectors_and_rows(kind):
    arrays = [
        np.arange(9, dtype=kind),
        np.array([7, 8, -9], np.int32),
        np.arange(6.0).reshape(2, 3),
        np.arange(18, dtype=kind).reshape(3, 6),
        np.array([[1, 2], [3, -4]], np.int32),
    ]
    slots, found = np.zeros(Things.slots, np.int64), np.zeros(11)
    slots[Things.fields["n"].first] = 41
    for name, values in zip(("numbers", "ids", "points", "boxes", "faces"), arrays, strict=True):
        slots[Things.fields[name].first] = values.ctypes.data
    load_table(slots.ctypes.data, kind, found)
    assert found.tolist() == [41, 3, -9, 3, 4, 5, 12, 15, 17, 3, -4]
    assert slots[:2].tolist() == [0, 0], "the table's slots begin at `first`"


def test_a_row_is_packed_by_name():
    assert BoxRow.packed(low=(1, 2, 3), size=4) == [4, 1, 2, 3, 0, 0]
    assert BoxRow.packed(weights=[5]) == [0, 0, 0, 0, 5, 0]
    with pytest.raises(TypeError, match="BoxRow has no field 'high'"):
        BoxRow.packed(high=1)
    with pytest.raises(TypeError, match=r"BoxRow.low: 2 numbers, of 3"):
        BoxRow.packed(low=(1, 2))


@numba.njit(**OPTIONS)
def unknown_field(address, kind):
    return samples(address, kind).depth[0]


@numba.njit(**OPTIONS)
def unknown_slot(address, kind):
    return things(address, kind).lights[0]


@numba.njit(**OPTIONS)
def unknown_row_field(address, kind):
    return things(address, kind).boxes[0].high


@numba.njit(**OPTIONS)
def one_index_too_few(address, kind):
    return samples(address, kind).draw[0]


@numba.njit(**OPTIONS)
def one_index_too_many(address, kind):
    return samples(address, kind).t[0, 0]


@numba.njit(**OPTIONS)
def store_into_the_scene(address, kind):
    things(address, kind).boxes[0] = 1.0


@pytest.mark.parametrize(
    "function",
    [unknown_field, unknown_slot, unknown_row_field, one_index_too_few, one_index_too_many, store_into_the_scene],
    ids=lambda function: function.__name__,
)
def test_what_the_layout_does_not_have_does_not_compile(function):
    with pytest.raises(TypingError):
        function(0, np.float32)
