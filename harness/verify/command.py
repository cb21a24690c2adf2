"""What `raybench verify` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from engines import registry
from engines.errors import ConfigError
from harness.commands import allow_here, consoles
from harness.settings import require_imports
from harness.verify import output
from harness.verify.battery import BROKEN, CASES, findings


def verify(names: Sequence[str], quick: bool, only: Sequence[str], out: Path | None, allow_imports: bool) -> int:
    """Runs the battery, prints and writes what it found; 1 where a promise is broken."""
    stdout, stderr = consoles()
    allow_here(allow_imports)
    for name in names:
        require_imports(name, allow_imports)
        if registry.is_file(name):
            raise ConfigError(f"{name}: a renderer by process answers no single rays: ask `raybench equivalence`")
    engines = [registry.engine(name) for name in names] if names else registry.all_engines()
    chosen = [case for case in CASES if not only or case.id in only or case.section in only]
    found = []
    with stderr.status("verify") as status:
        for finding in findings(engines, quick, chosen):
            status.update(f"{finding.engine} {finding.precision} {finding.case}: {finding.asked}")
            found.append(finding)
    output.show(found, stdout)
    folder = out or Path("results") / "verify"
    output.write(found, folder, quick)
    stdout.print(f"Written: {folder / 'verify.html'} (and .json, .csv, .tex)", soft_wrap=True)
    return int(any(finding.verdict == BROKEN for finding in found))
