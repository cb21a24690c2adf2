"""The engines `mitsuba` and `mitsuba_scalar`: Mitsuba 3 (Jakob et al. 2022) as a peer, in two of its variants.

Nothing of Mitsuba is imported before an engine is asked whether it can render, or to render.
"""

from engines.peers.mitsuba.engine import Engine, ScalarEngine

__all__ = ["Engine", "ScalarEngine"]
