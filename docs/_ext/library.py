"""What `import engines` gives, the functions of plugins that only a compiler can call, and the claims of conformance."""

import inspect

from markdown import code, plain, table

import engines
import engines.plugin
from engines.conformance import CLAIMS


def names() -> str:
    """Every name of `engines` with its first sentence, linked to where it is described."""
    rows = []
    for name in sorted(engines.__all__):
        found = getattr(engines, name)
        first = (inspect.getdoc(found) or "").split("\n\n")[0]
        rows.append((f"[{code(name)}](#{found.__module__}.{found.__qualname__})", plain(first)))
    return table(("Name", "What it is"), rows)


def plugin_functions() -> str:
    """Directives for what Sphinx takes for data: jitted functions and intrinsics."""
    found = [each for each in engines.plugin.__all__ if not _is_plain(getattr(engines.plugin, each))]
    return "```{eval-rst}\n" + "\n".join(f".. autofunction:: engines.plugin.{each}" for each in found) + "\n```\n"


def claims() -> str:
    """What the conformance suite holds of every engine."""
    rows = [(code(claim.__name__), plain((inspect.getdoc(claim) or "").split("\n\n")[0])) for claim in CLAIMS]
    return table(("Claim", "What must hold"), rows)


def _is_plain(found) -> bool:
    return inspect.isclass(found) or inspect.isroutine(found)
