"""The former place of `engines.peers.mitsuba`."""

import warnings

from engines.peers.mitsuba import *  # noqa: F403

warnings.warn("engines.mitsuba has moved: import engines.peers.mitsuba", DeprecationWarning, stacklevel=2)
