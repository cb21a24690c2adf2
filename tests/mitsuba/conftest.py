"""Fixtures of the tests of Mitsuba."""

import pytest


@pytest.fixture
def scalar_rgb():
    """Mitsuba's variant for what a test does with Mitsuba itself."""
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("scalar_rgb")
    yield
    if before is not None:
        mi.set_variant(before)
