"""Mitsuba itself, loaded when a test first uses it: after its marker was asked, and with the LLVM that the engine chooses."""

from engines.peers.mitsuba import library
from engines.peers.mitsuba.native import LOADING_THREADS


class _Mitsuba:
    def __getattr__(self, name):
        return getattr(library.modules()[0], name)

    def set_variant(self, name):
        """With as many threads as Mitsuba needs to load images, however many an engine has left it."""
        library.activate(name, LOADING_THREADS)


mi = _Mitsuba()
