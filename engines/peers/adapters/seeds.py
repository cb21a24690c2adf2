"""Seeds for renderers that take fewer bits than raybench's 64."""

from __future__ import annotations

import hashlib

BITS = 31
"""Of a derived seed: renderers take no more, some of them as a signed number."""


def derive_seed(seed: int, part: int | str = 0) -> int:
    """A seed in [1, 2^31) for `part` of what is rendered under `seed`: another one for every pair, the same one every time.

    All bits of `seed` count. 0 is left out: some renderers take it for a seed of their own choice.
    """
    digest = hashlib.sha256(f"{seed}/{part}".encode()).digest()
    return int.from_bytes(digest[:8], "big") % ((1 << BITS) - 1) + 1
