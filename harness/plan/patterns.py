"""The checkpoints of samplers that are good as whole patterns only, as their engine gives them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError
from engines.interface import Engine, FullPattern
from harness.measure.schedule import Schedule, checkpoints


def full_patterns(engine: Engine, sampler: Choice, schedule: Schedule) -> tuple[FullPattern, ...] | None:
    """The patterns of at most `max_spp` samples at the checkpoints, each once; None for a sampler without patterns.

    None of them where the smallest pattern is larger. Raises `ConfigError` where the engine answers something else.
    """
    if not callable(getattr(engine, "full_pattern", None)) or ":" in sampler.name:
        return None
    found: dict[int, FullPattern] = {}
    for pattern in _answers(engine, sampler.describe(), schedule):
        if pattern is None:
            return None
        if pattern.spp <= schedule.max_spp:
            found.setdefault(pattern.spp, pattern)
    return tuple(found.values())


def _answers(engine: Any, sampler: Mapping[str, Any], schedule: Schedule) -> Iterator[FullPattern | None]:
    last = 0
    for spp in checkpoints(schedule):
        try:
            answer = engine.full_pattern(sampler, spp)
        except RaybenchError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigError(f"engine {engine.name}: full_pattern failed: {type(error).__name__}: {error}") from error
        if answer is not None and not (_is_pattern(answer) and answer.spp >= max(spp, last)):
            raise ConfigError(
                f"engine {engine.name}: full_pattern({dict(sampler)}, {spp}) returned {answer!r}: None is expected, or a "
                f"FullPattern of {max(spp, last)} samples or more with its sampler"
            )
        yield answer
        last = 0 if answer is None else answer.spp


def _is_pattern(answer: Any) -> bool:
    if not isinstance(answer, FullPattern) or isinstance(answer.spp, bool) or not isinstance(answer.spp, int):
        return False
    return isinstance(answer.sampler, Mapping) and isinstance(answer.sampler.get("name"), str)
