"""The former place of `engines.peers.export`."""

import warnings

from engines.peers.export import *  # noqa: F403

warnings.warn("engines.export has moved: import engines.peers.export", DeprecationWarning, stacklevel=2)
