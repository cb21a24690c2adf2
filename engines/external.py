"""The former place of `engines.peers.external`."""

import warnings

from engines.peers.external import *  # noqa: F403

warnings.warn("engines.external has moved: import engines.peers.external", DeprecationWarning, stacklevel=2)
