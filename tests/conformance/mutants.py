"""The table of mutants: engines with one thing wrong, each entered with the claims that must notice.

A mutant is `small_engine` but for a method or two.
"""

import pytest

from tests.conformance.small_engine import Engine, Renderer

MUTANTS = []
"""Parameters of a test: a claim, and a class of engines that break it."""


def breaks(*claims):
    """Enters an engine, or a renderer, into the table as one that breaks `claims`."""

    def enter(made):
        engine = type(made.__name__, (Engine,), {"renderer": made}) if issubclass(made, Renderer) else made
        MUTANTS.extend(pytest.param(claim, engine, id=f"{made.__name__}-{claim.__name__}") for claim in claims)
        return made

    return enter
