"""What every engine must hold, ours and third parties' alike, examined through the public interface alone.

    from engines.conformance import assert_conforms, check_engine

    for finding in check_engine(my_engine):
        print("ok   " if finding.ok else "FAILS", finding.claim, finding.detail)

An engine that by `why_not` declines what a claim needs is not failed for it: the finding is ok and quotes the engine.
Nor is one that does not promise it: an attribute `not_promised` maps names of claims to reasons, which are quoted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from engines.conformance import asking, concurrency, hits, light, rendering
from engines.conformance.subject import Broken, Declined, Subject
from engines.interface import Engine

__all__ = ["CLAIMS", "Finding", "assert_conforms", "check_engine"]

Claim = Callable[[Subject], None]

CLAIMS: tuple[Claim, ...] = (
    *asking.CLAIMS, *hits.CLAIMS, *rendering.CLAIMS, *concurrency.CLAIMS, *light.CLAIMS,
)  # fmt: skip
"""Every claim; the first line of its docstring says what must hold."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Whether a claim holds of an engine. `detail` is what was seen where it does not, or why it was not examined."""

    claim: str
    ok: bool
    detail: str = ""


def check_engine(engine: Engine, quick: bool = True) -> list[Finding]:
    """One finding a claim, in the order of `CLAIMS`.

    `quick` examines the default accelerator and precision and leaves out most combinations of shader and sampler;
    without it everything that the engine lists is built, traced and rendered, which takes minutes where it compiles.
    """
    subject = Subject(engine, quick)
    return [_examine(claim, subject) for claim in CLAIMS]


def assert_conforms(engine: Engine, quick: bool = True) -> None:
    """Raises AssertionError with a line for every claim that does not hold."""
    broken = [finding for finding in check_engine(engine, quick) if not finding.ok]
    lines = "".join(f"\n  {finding.claim}\n    but {finding.detail}" for finding in broken)
    if broken:
        raise AssertionError(f"engine {engine.name!r} breaks {len(broken)} of {len(CLAIMS)} claims:{lines}")


def _examine(claim: Claim, subject: Subject) -> Finding:
    sentence = sentence_of(claim)
    try:
        claim(subject)
    except Declined as reason:
        return Finding(sentence, True, f"not examined: {reason}")
    except Broken as seen:
        excuse = getattr(subject.engine, "not_promised", {}).get(claim.__name__)
        return Finding(sentence, excuse is not None, f"not promised: {excuse}: {seen}" if excuse else str(seen))
    except Exception as error:
        return Finding(sentence, False, f"{type(error).__name__}: {error}")
    return Finding(sentence, True)


def sentence_of(claim: Claim) -> str:
    """What a claim says must hold."""
    return (claim.__doc__ or claim.__name__).splitlines()[0]
