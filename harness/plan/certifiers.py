"""Which engine certifies a reference, at what size and with how many samples.

A certifier is of another lineage than the reference's engine: engines of one lineage share code, and so its errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from engines.choices import SAMPLERS, Choice, resolve
from engines.errors import ConfigError
from engines.interface import Engine
from engines.registry import lineage_of
from harness.plan.references import REPLICATES, Certifier
from harness.settings import CellSettings

FAST, SMALL, LARGE = ("embree",), ("numpy",), ("mitsuba", "mitsuba_scalar")
"""Candidates, in the order in which they are asked: the fast one, then numpy where the image is small, then Mitsuba."""
SAMPLES = 1 << 27
"""Samples of the whole image that a certifier may take. Sixteen million leave tiles of 256x256 pixels bounded at 6 to 8 %."""
SLOW_SAMPLES = {"raybench-numpy": 1 << 19}
"""The same of a slower lineage: numpy traces some 30,000 a second."""
LEAST_SPP = 32
"""Where a lineage cannot afford so many, both engines make a smaller image."""
LARGEST_FACTOR = 16


class Share(NamedTuple):
    """What is rendered: `spp` samples in each replicate, at 1 / `factor` of the reference's width and height."""

    factor: int
    spp: int


def share(lineage: str, width: int, height: int, reference_spp: int) -> Share:
    """As many samples as `lineage` can afford, but no more than the reference has.

    The factor divides width and height; where none is large enough, the image stays large, and the samples few.
    """
    most = SLOW_SAMPLES.get(lineage, SAMPLES)
    factors = [f for f in range(1, LARGEST_FACTOR + 1) if width % f == 0 and height % f == 0]
    factor = next((f for f in factors if width * height * LEAST_SPP <= most * f * f), 1)
    each = min(most * factor**2 // (width * height), reference_spp) // REPLICATES
    return Share(factor, 2 ** (max(each, 1).bit_length() - 1))


def samplers(spp: int) -> list[Choice]:
    """What a certifier samples with that lacks the reference's sampler: whole patterns of strata, or independent numbers.

    Within a pixel strata find the share of a small bright light, on which the mean of an image may depend, far more exactly.
    """
    whole = spp in (4, 16, 64, 256, 1024, 4096)
    written = [*([{"name": "stratified", "strata": spp}] if whole else []), "random"]
    return [resolve("sampler", each, SAMPLERS) for each in written]


def candidates(width: int, height: int) -> tuple[str, ...]:
    """Engines that may certify a reference where the config names none; not all of them are installed."""
    small = width * height * LEAST_SPP <= SLOW_SAMPLES["raybench-numpy"]
    return (*FAST, *SMALL, *LARGE) if small else (*FAST, *LARGE, *SMALL)


def refuse_own_lineage(where: str, certifier: Engine, name: str, reference: Engine, reference_name: str) -> None:
    """Raises `ConfigError` where both engines are of one lineage."""
    lineage = lineage_of(certifier)
    if lineage == lineage_of(reference):
        raise ConfigError(
            f"{where} = {name!r}: is of the lineage {lineage}, as the reference's engine {reference_name} is, and would "
            "share its errors: an engine of another lineage is expected, or auto"
        )


def first_able(names: tuple[str, ...], lineage: str, attempt: Callable[[str], Certifier | None]) -> Certifier | None:
    """The first of `names` that is of another lineage than `lineage` and can; else one that says why none can."""
    refusals: dict[str, Certifier] = {}
    for name in names:
        found = attempt(name)
        if found is None or found.lineage == lineage:
            continue
        if found.why_not is None:
            return found
        refusals[name] = found
    if not refusals:
        return None
    reasons = "; ".join(f"{name}: {found.why_not}" for name, found in refusals.items())
    return next(iter(refusals.values()))._replace(why_not=f"no engine of another lineage can: {reasons}")


def smaller(settings: CellSettings, factor: int) -> CellSettings:
    """The settings of an image of 1 / `factor` of the width and height."""
    return replace(settings, width=settings.width // factor, height=settings.height // factor)
