"""The former place of `engines.peers.adapters`."""

import warnings

from engines.peers.adapters import *  # noqa: F403

warnings.warn("engines.adapters has moved: import engines.peers.adapters", DeprecationWarning, stacklevel=2)
