"""Seeds of 32 bits for Mitsuba out of ours of 64: different for every render, pass and pattern."""

from __future__ import annotations

_MASK = 0xFFFFFFFF


def seed_of(seed: int, part: int) -> int:
    """The 32-bit seed of the `part`-th pass or pattern of a render under the 64-bit `seed`."""
    return _mix((_mix((_mix(seed & _MASK) + (seed >> 32)) & _MASK) + part * 0x9E3779B9) & _MASK)


def _mix(x: int) -> int:
    """Wellons' lowbias32."""
    x ^= x >> 16
    x = (x * 0x7FEB352D) & _MASK
    x ^= x >> 15
    x = (x * 0x846CA68B) & _MASK
    return x ^ (x >> 16)
