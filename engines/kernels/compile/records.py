"""Named, typed memory: what kernels write as `rays.origin[lane]`, `scene.lights[i].color`.

Three kinds of layout are declared as classes:

- `LaneRecord`: the state of sixteen lanes, field by field, each field sixteen numbers in a row. `lane_view(Layout)` makes
  the function `view(address, real)`. Of a view, `view.field[lane]` loads and `view.field[lane] = value` stores; `view[k]`
  is the view of the k-th such record in memory that holds several. `lane_numbers(view.field, lane)` loads a tuple. A field may
  be a `record`, a NamedTuple with fields of its own.
- `Row`: numbers of one type side by side; `row.field` loads.
- `Table`: 64-bit slots, each the address of an array or a whole number. `table_view(Layout)` makes `view(address, real)`,
  of which `view.array[i]` and `view.number` load.

A view is an address and its field a constant offset: nothing of this is left in machine code.
"""

from engines.kernels.compile.fields import (
    LANES,
    REAL,
    Field,
    array,
    bits_of,
    doubles,
    flag,
    integer,
    real,
    reals,
    record,
    rows,
    scalar,
    vector,
    vectors,
)
from engines.kernels.compile.lanes import LaneField, LaneRecord, lane_numbers, lane_view
from engines.kernels.compile.memory import address_of, array_at, prefetch
from engines.kernels.compile.tables import Row, Table, table_view

__all__ = [
    "LANES",
    "REAL",
    "Field",
    "LaneField",
    "LaneRecord",
    "Row",
    "Table",
    "address_of",
    "array",
    "array_at",
    "bits_of",
    "doubles",
    "flag",
    "integer",
    "lane_numbers",
    "lane_view",
    "prefetch",
    "real",
    "reals",
    "record",
    "rows",
    "scalar",
    "table_view",
    "vector",
    "vectors",
]
