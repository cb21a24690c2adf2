"""Fixtures of the tests of Mitsuba."""

import pytest

from tests.mitsuba.peer import mi


@pytest.fixture
def scalar_rgb():
    """Mitsuba's variant for what a test does with Mitsuba itself."""
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    yield
    if before is not None:
        mi.set_variant(before)
