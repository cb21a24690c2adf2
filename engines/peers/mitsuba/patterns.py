"""How many samples a pattern of Mitsuba's samplers has: each rounds `sample_count` up, in its own way."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from engines.interface import FullPattern

USUAL = 64
"""Samples in a pattern where the settings leave it open."""
LARGEST = 65_536
"""`sample_count` of a sampler of Mitsuba's own."""
LARGEST_STRATA = 4096


def full_pattern(sampler: Mapping[str, Any], spp: int) -> FullPattern | None:
    """The smallest whole pattern of `sampler`, as plain data, with at least `spp` samples per pixel; None without patterns.

    Where `sample_count` is given, the smallest whole number of such patterns. `strata`, which has a default that cannot be
    told from a choice, does not count as given. Above the largest pattern several of them are taken.
    """
    name = sampler["name"]
    rounded = int if name == "mitsuba" else ROUNDED.get(name)  # one of the user's must keep to the count
    if rounded is None:
        return None
    option, largest = ("strata", LARGEST_STRATA) if name == "stratified" else ("sample_count", LARGEST)
    given = None if option == "strata" else sampler.get(option)
    count = min(spp, largest) if given is None else given
    size = rounded(count)
    return FullPattern(-(-spp // size) * size, {**sampler, option: min(size, largest)})


def _power_of_four(count: int) -> int:
    """At least 4."""
    return 4 ** max(1, math.ceil(math.log2(count) / 2))


def _rectangle(count: int) -> int:
    """Of a grid with the root of `count` rows, rounded down."""
    rows = math.isqrt(count)
    return rows * -(-count // rows)


def _square_of_a_prime(count: int) -> int:
    root = 2
    while root * root < count or any(root % divisor == 0 for divisor in range(2, math.isqrt(root) + 1)):
        root += 1
    return root * root


ROUNDED: dict[str, Callable[[int], int]] = {
    "stratified": _power_of_four,
    "ldsampler": _power_of_four,
    "multijitter": _rectangle,
    "orthogonal": _square_of_a_prime,
}
"""Samples in a pattern for a requested count. Mitsuba's `stratified` takes any square, raybench's `strata` a power of four."""
