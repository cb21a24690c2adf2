"""Tone mappers: what holds for all of them, and the anchors of each curve."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import tonemap
from engines.errors import ConfigError, UnknownName
from engines.tonemap import TONE_MAPPERS, register, tone_mapper

OURS = ["linear", "srgb", "reinhard", "aces"]
radiance = st.floats(0.0, allow_nan=False, allow_infinity=True)


@pytest.mark.parametrize("name", OURS)
@given(low=radiance, high=radiance)
def test_brighter_radiance_is_never_darker_on_the_display(name, low, high):
    low, high = min(low, high), max(low, high)
    dark, bright = tone_mapper(name)(np.array([low, high]))
    assert 0.0 <= dark <= bright + 1e-12
    assert bright <= 1.0


@pytest.mark.parametrize("name", OURS)
def test_black_is_black_and_infinitely_bright_is_white(name):
    black, white, negative = tone_mapper(name)(np.array([0.0, np.inf, -1.0]))
    assert (black, negative) == (0.0, 0.0)
    assert white == pytest.approx(1.0)


@pytest.mark.parametrize("name", OURS)
def test_no_value_raises_a_floating_point_warning(name):
    with np.errstate(all="raise", under="ignore"):
        tone_mapper(name)(np.array([0.0, 5e-324, 1e-3, 1.0, 1e155, 1.7e308, np.inf, -np.inf]))


@pytest.mark.parametrize(
    ("name", "given_radiance", "display"),
    [
        ("linear", 0.25, 0.25),
        ("srgb", 0.0031308, 0.04045),
        ("srgb", 0.2140411, 0.5),
        ("srgb", 1.0, 1.0),
        ("reinhard", 0.2140411 / (1 - 0.2140411), 0.5),
        ("aces", 1.0, 1.055 * (2.54 / 3.16) ** (1 / 2.4) - 0.055),
    ],
)
def test_curves_pass_through_their_anchors(name, given_radiance, display):
    assert tone_mapper(name)(np.array(given_radiance)) == pytest.approx(display, abs=2e-6)


def test_srgb_is_continuous_at_its_knee():
    below, above = tonemap.srgb(np.array([0.0031308, np.nextafter(0.0031308, 1.0)]))
    assert above == pytest.approx(below, abs=1e-7)


def test_a_registered_tone_mapper_is_found_by_name(monkeypatch):
    monkeypatch.setattr(tonemap, "TONE_MAPPERS", dict(TONE_MAPPERS))
    register("half", lambda x: x / 2)
    assert tone_mapper("half")(np.array(1.0)) == 0.5


def test_a_name_is_registered_once():
    with pytest.raises(ConfigError, match="srgb"):
        register("srgb", tonemap.linear)


def test_only_callables_are_registered():
    with pytest.raises(ConfigError, match="callable"):
        register("none at all", 3)  # pyright: ignore[reportArgumentType]


def test_a_callable_is_its_own_tone_mapper():
    assert tone_mapper(np.sqrt) is np.sqrt


def test_an_unknown_tone_mapper_names_the_nearest():
    with pytest.raises(UnknownName, match="did you mean 'reinhard'"):
        tone_mapper("rheinhard")


def test_what_is_no_name_is_refused():
    with pytest.raises(ConfigError, match="a name or a callable"):
        tone_mapper(["srgb"])  # pyright: ignore[reportArgumentType]
