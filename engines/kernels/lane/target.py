"""What lane functions take from the machine they run on, besides arithmetic: another target supplies its own."""

from __future__ import annotations

import numpy as np

sqrt, floor = np.sqrt, np.floor
