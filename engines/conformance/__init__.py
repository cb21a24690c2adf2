"""The claims that every engine must meet, raybench's and third parties', checked only through the public interface.

    from engines.conformance import assert_conforms, check_engine

    for finding in check_engine(my_engine):
        print(finding)

A claim has a key, the name of its function. If an engine refuses a scene or setting that a claim needs, by `why_not` or by
raising `Unsupported` from `trace` or `occluded`, the claim is declined, with the engine's words, and not broken. An attribute
`not_promised` maps keys to reasons; such claims are not examined.

Two more attributes help engines with few choices. `listed` maps `shader`, `sampler` and `threads` to the accepted values, if
raybench's names alone would not be accepted. `reads_files` is true if a scene must be in a file of raybench's format: claims
then write theirs into files first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from engines.conformance import asking, concurrency, hits, light, rendering
from engines.conformance.subject import Broken, Declined, Subject
from engines.errors import ConfigError, UnknownName
from engines.interface import Engine

__all__ = ["BROKEN", "CLAIMS", "DECLINED", "HOLDS", "NOT_PROMISED", "Finding", "assert_conforms", "check_engine"]

Claim = Callable[[Subject], None]

CLAIMS: tuple[Claim, ...] = (*asking.CLAIMS, *hits.CLAIMS, *rendering.CLAIMS, *concurrency.CLAIMS, *light.CLAIMS)
"""Every claim; the first line of its docstring says what must hold."""

HOLDS, BROKEN, DECLINED, NOT_PROMISED = "holds", "broken", "declined", "not promised"


@dataclass(frozen=True, slots=True)
class Finding:
    """What became of a claim: `verdict` is one of `HOLDS`, `BROKEN`, `DECLINED` and `NOT_PROMISED`.

    `claim` is the sentence that must hold; `detail` what was seen where it does not, or why it was not examined.
    """

    key: str
    claim: str
    verdict: str
    detail: str = ""

    @property
    def ok(self) -> bool:
        """Whether nothing is held against the engine."""
        return self.verdict != BROKEN

    def __str__(self) -> str:
        return f"{self.verdict:12} {self.key}: {self.claim}" + (f"\n{'':12}   {self.detail}" if self.detail else "")


def check_engine(engine: Engine, quick: bool = True) -> list[Finding]:
    """One finding a claim, in the order of `CLAIMS`.

    `quick` examines the default accelerator and precision and leaves out most combinations of shader and sampler;
    without it everything that the engine lists is built, traced and rendered, which takes minutes where it compiles.
    Raises `UnknownName` where `not_promised` has a key that no claim has.
    """
    excuses = _not_promised(engine)
    with Subject(engine, quick) as subject:
        return [_examine(claim, subject, excuses) for claim in CLAIMS]


def assert_conforms(engine: Engine, quick: bool = True) -> None:
    """Raises AssertionError with a line for every claim that does not hold."""
    broken = [finding for finding in check_engine(engine, quick) if not finding.ok]
    lines = "".join(f"\n  {finding.key}: {finding.claim}\n    but {finding.detail}" for finding in broken)
    if broken:
        raise AssertionError(f"engine {engine.name!r} breaks {len(broken)} of {len(CLAIMS)} claims:{lines}")


def _not_promised(engine: Engine) -> Mapping[str, str]:
    """The engine's excuses, by the keys of claims."""
    excuses: Any = getattr(engine, "not_promised", {})
    if not isinstance(excuses, Mapping):
        raise ConfigError(f"engine {engine.name!r}: not_promised = {excuses!r}: a mapping from claims to reasons is expected")
    known = [key_of(claim) for claim in CLAIMS]
    for key in excuses:
        if key not in known:
            raise UnknownName(f"claim in not_promised of engine {engine.name!r}:", key, known)
    return excuses


def _examine(claim: Claim, subject: Subject, excuses: Mapping[str, str]) -> Finding:
    key, verdict, detail = key_of(claim), HOLDS, ""
    try:
        if key in excuses:
            verdict, detail = NOT_PROMISED, excuses[key]
        else:
            claim(subject)
    except Declined as reason:
        verdict, detail = DECLINED, str(reason)
    except Broken as seen:
        verdict, detail = BROKEN, str(seen)
    except Exception as error:
        verdict, detail = BROKEN, f"{type(error).__name__}: {error}"
    return Finding(key, sentence_of(claim), verdict, detail)


def key_of(claim: Claim) -> str:
    """The name by which `not_promised` calls a claim."""
    return claim.__name__


def sentence_of(claim: Claim) -> str:
    """What a claim says must hold."""
    return (claim.__doc__ or claim.__name__).splitlines()[0]
