"""Numbers and lists as text."""

from __future__ import annotations

import math
from collections.abc import Sequence

from harness.metrics import TRIMMED_FRACTION
from harness.report.plots.curves import error_label
from harness.report.tables.model import number_text
from harness.statistics import Estimate, Ratio

WORST = f"{100 * TRIMMED_FRACTION:g} %"
"""Of the pixels, those with the largest error."""


def interval(estimate: Estimate | Ratio) -> str:
    """`2.1 (1.9 to 2.3)`: a value with its interval, or alone where there is none."""
    value, low, high = estimate[:3]
    text = "unbounded" if math.isinf(value) else number_text(value)
    if math.isnan(low) or math.isnan(high) or low == high:
        return text
    return f"{text} ({number_text(low)} to {'any' if math.isinf(high) else number_text(high)})"


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return "".join(names) if len(names) < 2 else f"{', '.join(names[:-1])} and {names[-1]}"


def error_name(metric: str) -> str:
    """A metric as an error: `relMSE (ε = 0.01)`."""
    return error_label(metric).replace("−", "-")
