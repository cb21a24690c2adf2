"""What a certificate says of a reference: whether it holds, and in which words. `run.certificates` makes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.analysis.equivalence import bounds


def certifies(event: Mapping[str, Any]) -> bool:
    """Whether a certificate holds: the same image, by an engine that is known to be of another lineage."""
    lineage, reference = event.get("lineage"), event.get("reference_lineage")
    return event["verdict"] in ("identical", "equivalent") and None not in (lineage, reference) and lineage != reference


def refutes(event: Mapping[str, Any]) -> bool:
    return event["verdict"] == "different"


def certificate_text(event: Mapping[str, Any]) -> str:
    """A certificate in a sentence."""
    if event["verdict"] == "impossible":
        return f"uncertified: {event['message']}"
    if event.get("lineage") is None or event.get("image_bound") is None:
        return f"uncertified: {event['engine']} was compared by an older rule, which did not require another lineage"
    if event["lineage"] == event.get("reference_lineage"):
        return f"uncertified: {event['engine']} is of the reference's own lineage, {event['lineage']}"
    size = f"{event['width']}x{event['height']}, " if event.get("width") else ""
    by = f"{event['engine']} ({size}{event['spp']} spp)"
    seen = bounds(event["image_bound"], event["tile_bound"])
    if certifies(event):
        return f"certified by {by}: {seen}"
    if refutes(event):
        return f"REFUTED: {by} makes another image: {seen}"
    return f"uncertified: {by} is unresolved, more samples are needed: {seen}"
