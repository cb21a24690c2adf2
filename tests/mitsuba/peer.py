"""Mitsuba itself, loaded when a test first uses it: after its marker was asked, and with the LLVM that the engine chooses."""

from engines.mitsuba import library


class _Mitsuba:
    def __getattr__(self, name):
        return getattr(library.modules()[0], name)


mi = _Mitsuba()
