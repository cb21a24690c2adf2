"""Images of few different numbers, as those from files of eight bits, kept with a byte a number: a quarter of the memory, so
that more of it is in a near cache."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import kernel

COLORS = 256
BYTES = 4 * COLORS
"""Of a palette, which lies before the image's bytes."""
_SLOTS, _FREE = 4096, -1


@cache
def _kernel() -> Any:
    """The function (bits, palette, slots, places) -> whether `palette` has room: fills it with the different numbers among
    `bits`, and `places` with where each is there. `slots` is a hash table."""

    def index(bits, palette, slots, places):
        count = 0
        for k in range(len(bits)):
            number = bits[k]
            slot = ((np.int64(number) * 0x9E3779B1) >> 20) & (_SLOTS - 1)
            while slots[slot] != _FREE and palette[slots[slot]] != number:
                slot = (slot + 1) & (_SLOTS - 1)
            if slots[slot] == _FREE:
                if count == COLORS:
                    return False
                slots[slot] = count
                palette[count] = number
                count += 1
            places[k] = slots[slot]
        return True

    return kernel(index)


def indexed(image: NDArray[np.float32]) -> NDArray[np.uint8] | None:
    """A palette of float32 numbers, and behind it a byte for each number of the contiguous `image`; None where it has more
    than 256 different ones."""
    memory = np.zeros(BYTES + image.size, np.uint8)
    slots = np.full(_SLOTS, _FREE, np.int64)
    fits = _kernel()(image.reshape(-1).view(np.int32), memory[:BYTES].view(np.int32), slots, memory[BYTES:])
    return memory if fits else None
