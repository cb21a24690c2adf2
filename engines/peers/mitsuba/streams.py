"""Random numbers for Mitsuba: seeds of 32 bits, and a stream of its own for every sample of every pixel.

Mitsuba's sampler `independent` seeds a PCG32 stream (O'Neill 2014) for each lane of a launch from the lane's number, so that
its samples depend on how many a launch takes. Here the same generator is seeded, by the same cipher (the Tiny Encryption
Algorithm), from the pixel and the index of the sample: samples may then be split into launches in any way.
"""

from __future__ import annotations

from typing import Any

_MASK = 0xFFFFFFFF


def seed_of(seed: int, part: int) -> int:
    """The 32-bit seed of the `part`-th pass or pattern of a render under the 64-bit `seed`: another one for each."""
    return _mix((_mix((_mix(seed & _MASK) + (seed >> 32)) & _MASK) + part * 0x9E3779B9) & _MASK)


def _mix(x: int) -> int:
    """Wellons' lowbias32."""
    x ^= x >> 16
    x = (x * 0x7FEB352D) & _MASK
    x ^= x >> 15
    x = (x * 0x846CA68B) & _MASK
    return x ^ (x >> 16)


def stream_sampler(mi: Any, dr: Any, seed: int, pixel: Any, index: Any) -> Any:
    """A `mitsuba.Sampler`: `pixel` and `index` are arrays of UInt32, a lane each, and `seed` has 64 bits."""
    low, high = (dr.opaque(mi.UInt32, word) for word in (seed & 0xFFFFFFFF, seed >> 32))  # not part of the kernel
    first, second = mi.sample_tea_32(pixel, index)
    state, sequence = mi.sample_tea_32(first ^ low, second ^ high)
    return _class(mi)(mi.PCG32(initstate=mi.UInt64(state), initseq=mi.UInt64(sequence)))


_classes: dict[Any, Any] = {}


def _class(mi: Any) -> Any:
    """Made for the variant that is active, whose `Sampler` it derives from."""
    if mi.Sampler not in _classes:

        class Streams(mi.Sampler):
            def __init__(self, numbers: Any) -> None:
                super().__init__(mi.Properties())
                self.numbers = numbers

            def next_1d(self, active: Any = True) -> Any:
                return self.numbers.next_float32(active)

            def next_2d(self, active: Any = True) -> Any:
                x = self.numbers.next_float32(active)
                return mi.Point2f(x, self.numbers.next_float32(active))

        _classes[mi.Sampler] = Streams
    return _classes[mi.Sampler]
