"""Which of several lane functions is called, by a kind that differs from lane to lane."""

from __future__ import annotations

from functools import cache
from typing import Any

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select


@cache
def dispatch(cases: tuple[tuple[int, Any], ...], branches: bool = False) -> Any:
    """The function (kind, found, *arguments) -> what the function of the case `kind` gives, `found` where there is none.

    `cases` are pairs (kind, function). All of them are computed and one is selected, so that loops over lanes stay vector code;
    with `branches`, for scalar code, only the one."""
    if not cases:
        return _found
    (own, function), rest = cases[0], dispatch(cases[1:], branches)

    @inline
    def by_branch(kind, found, *arguments):
        if kind == own:
            return function(*arguments)
        return rest(kind, found, *arguments)

    @inline
    def by_selection(kind, found, *arguments):
        return rest(kind, select(kind == own, function(*arguments), found), *arguments)

    return by_branch if branches else by_selection


@inline
def _found(kind, found, *arguments):
    return found
