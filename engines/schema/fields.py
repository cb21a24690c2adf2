"""Functions that read a Located value of one type: each returns a plain value, or raises what `Located.refuse` makes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import suggestion
from engines.memory import lacking_memory
from engines.schema.yaml_file import Located

Triple = tuple[float, float, float]


def mapping(node: Located, known: Collection[str], required: Iterable[str] = ()) -> dict[str, Located]:
    """The children of a mapping that has the required keys and none but the known ones."""
    if not isinstance(node.value, dict):
        raise node.refuse(f"must be a mapping with keys of {', '.join(known)}")
    for key in node.value:
        if key not in known:
            raise node.unknown_key(key, known)
    for key in required:
        if key not in node.value:
            raise node.refuse_key(key, "is missing")
    return node.value


def items(node: Located, what: str) -> list[Located]:
    """The children of a list; null counts as an empty one."""
    if node.value is None:
        return []
    if not isinstance(node.value, list):
        raise node.refuse(f"must be a list of {what}")
    return node.value


def text(node: Located) -> str:
    """Text with anything but blanks in it."""
    if not isinstance(node.value, str) or not node.value.strip():
        raise node.refuse("must be text")
    return node.value


def boolean(node: Located) -> bool:
    """True or false; 0 and 1 are refused."""
    if not isinstance(node.value, bool):
        raise node.refuse("must be true or false")
    return node.value


def one_of(node: Located, known: Collection[str], what: str) -> str:
    """One of the `known` names of a `what`; others are refused with the nearest known one."""
    if not isinstance(node.value, str) or node.value not in known:
        found = node.value if isinstance(node.value, str) else ""
        raise node.refuse(f"unknown {what}: {suggestion(found, known)}")
    return node.value


def integer(node: Located, low: int, high: int) -> int:
    """A whole number in [low, high]; 4.0 is none."""
    value = node.value
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise node.refuse(f"must be an integer in [{low}, {high}]")
    return value


def number(node: Located) -> float:
    """A finite number."""
    value = node.value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise node.refuse("must be a number")
    try:
        value = float(value)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise node.refuse("must be finite")
    return value


def positive(node: Located) -> float:
    """A finite number above 0."""
    value = number(node)
    if value <= 0.0:
        raise node.refuse("must be greater than 0")
    return value


def angle(node: Located) -> float:
    """Degrees in (0, 180)."""
    value = number(node)
    if not 0.0 < value < 180.0:
        raise node.refuse("must lie in (0, 180) degrees")
    return value


def within(node: Located, low: float, high: float) -> float:
    """A number in [low, high]."""
    value = number(node)
    if not low <= value <= high:
        raise node.refuse(f"must lie in [{low:g}, {high:g}]")
    return value


def triple(node: Located) -> Triple:
    """Three finite numbers."""
    a, b, c = (number(item) for item in several(node, 3, "must be three numbers"))
    return a, b, c


def color(node: Located, high: float = math.inf) -> Triple:
    """A number for grey or [r, g, b], each in [0, high]."""
    if isinstance(node.value, (list, np.ndarray)):
        r, g, b = (_channel(item, high) for item in several(node, 3, "must be a number or [r, g, b]"))
        return r, g, b
    grey = _channel(node, high)
    return grey, grey, grey


def direction(node: Located) -> Triple:
    """Three numbers, not all zero, as a unit vector."""
    unit_vector = unit(triple(node))
    if unit_vector is None:
        raise node.refuse("must not be the zero vector")
    return unit_vector


def towards(node: Located, start: Triple, name: str) -> Triple:
    """The unit vector from `start`, which messages call `name`, to the point at `node`."""
    target = triple(node)
    unit_vector = unit((target[0] - start[0], target[1] - start[1], target[2] - start[2]))
    if unit_vector is None:
        raise node.refuse(f"must differ from {name}")
    if not all(map(math.isfinite, unit_vector)):
        raise node.refuse(f"too far from {name}")
    return unit_vector


def unit(vector: Triple) -> Triple | None:
    """`vector` at length 1, without overflow or underflow on the way; None for the zero vector."""
    largest = max(map(abs, vector))
    if largest == 0.0:
        return None
    scaled = [x / largest for x in vector]
    length = math.hypot(*scaled)
    return scaled[0] / length, scaled[1] / length, scaled[2] / length


def rows(node: Located, dtype: type, low: float = -math.inf, high: float = math.inf, width: int = 3) -> NDArray[Any]:
    """A list of `width` numbers each, three or two, or an array (n, width), as an array of `dtype` with every number in
    [low, high].

    For integers, numbers with a fraction are refused.
    """
    if isinstance(node.value, np.ndarray):
        return _array_rows(node, node.value, dtype, low, high, width)
    read = (lambda item: integer(item, int(low), int(high))) if issubclass(dtype, np.integer) else number
    expected = "must be three numbers" if width == 3 else "must be two numbers"
    shown = "[a, b, c]" if width == 3 else "[a, b]"
    numbers = [[read(item) for item in several(row, width, expected)] for row in items(node, shown)]
    return np.array(numbers, dtype).reshape(-1, width)


def _array_rows(node: Located, value: NDArray[Any], dtype: type, low: float, high: float, width: int) -> NDArray[Any]:
    kinds = "iu" if issubclass(dtype, np.integer) else "iuf"
    if value.ndim != 2 or value.shape[1] != width or value.dtype.kind not in kinds:
        expected = f"must have the shape (n, {width}) and numbers of kind {kinds}"
        raise node.refuse(f"array {value.shape} of {value.dtype}: {expected}")
    good = np.isfinite(value) & (value >= low) & (value <= high)
    if not good.all():
        row, column = (int(i) for i in np.argwhere(~good)[0])
        expected = "must be finite" if math.isinf(high) else f"must be an integer in [{low:g}, {high:g}]"
        raise node.origin.error(f"{node.where}[{row}][{column}] = {value[row, column]}: {expected}")
    return np.array(value, dtype)


def refuse_above_memory(node: Located, needed: float, what: str) -> None:
    """Raises when `needed` bytes are more than the memory of this machine, or than this process may use."""
    if lacks := lacking_memory(needed):
        raise node.refuse(f"{what} {lacks}")


def several(node: Located, count: int, expected: str) -> list[Located]:
    """The `count` children of a list, or of an array of numbers; what else stands there is refused with `expected`."""
    value = node.value
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iuf":
        path = node.path
        value = [Located(x.item(), node.origin, (*path, i), node.line, node.line) for i, x in enumerate(value)]
    if not isinstance(value, list) or len(value) != count:
        raise node.refuse(expected)
    return value


def _channel(node: Located, high: float) -> float:
    value = number(node)
    if not 0.0 <= value <= high:
        raise node.refuse("must not be negative" if math.isinf(high) else f"must lie in [0, {high:g}]")
    return value
