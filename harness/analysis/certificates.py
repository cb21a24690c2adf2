"""What a certificate says of a reference: whether it holds, and in which words. `run.certificates` makes them."""

from __future__ import annotations

from harness.analysis.equivalence import bounds
from harness.store.records import Certificate


def certifies(certificate: Certificate) -> bool:
    """Whether a certificate holds: the same image, by an engine of another lineage."""
    return certificate.verdict in ("identical", "equivalent") and certificate.lineage != certificate.reference_lineage


def refutes(certificate: Certificate) -> bool:
    """Whether the engine makes another image than the reference's."""
    return certificate.verdict == "different"


def certificate_text(certificate: Certificate) -> str:
    """A certificate in a sentence."""
    engine, lineage = certificate.engine, certificate.lineage
    if certificate.verdict == "impossible":
        return f"uncertified: {certificate.message}"
    if lineage == certificate.reference_lineage:
        return f"uncertified: {engine} is of the reference's own lineage, {lineage}"
    by = f"{engine} ({certificate.width}x{certificate.height}, {certificate.spp} spp)"
    seen = bounds(*certificate.bounds)
    if certifies(certificate):
        return f"certified by {by}: {seen}"
    if refutes(certificate):
        return f"REFUTED: {by} makes another image: {seen}"
    return f"uncertified: {by} is unresolved, more samples are needed: {seen}"
