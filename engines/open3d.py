"""The former place of `engines.peers.open3d`."""

import warnings

from engines.peers.open3d import *  # noqa: F403

warnings.warn("engines.open3d has moved: import engines.peers.open3d", DeprecationWarning, stacklevel=2)
