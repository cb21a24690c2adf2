"""What shares a figure: the contestants of one scene, shader, size, division and machine; and how many curves are split."""

from __future__ import annotations

import math
from dataclasses import dataclass

from engines.choices import Choice
from harness.analysis import Analysis, Verdict
from harness.analysis.model import Group, ranked_together
from harness.metrics import Reference
from harness.report.plots.style import MOST_CURVES, file_stem
from harness.store.results import Results, brief_choice

FACET_AXES = ("engine", "sampler", "accelerator", "threads", "precision", "shader")


@dataclass
class Panel:
    """Verdicts that may be compared in one picture. `title` names the scene, and what else varies of what they share."""

    title: str
    verdicts: list[Verdict]

    @property
    def stem(self) -> str:
        return file_stem(self.title)

    @property
    def scene(self) -> str:
        return self.verdicts[0].contestant.settings.scene


class Facet:
    """One subplot: the verdicts it shows in colour; the panel's others stand behind them in grey."""

    def __init__(self, title: str, verdicts: list[Verdict]) -> None:
        self.title, self.verdicts = title, verdicts


def panels(analysis: Analysis) -> list[Panel]:
    """One panel a scene, shader, size, division and machine, without the A/A twin's second label.

    In each scene the open division comes last. A title names the scene, the shader and size if its panels differ in them, the
    open division, and the machine if there are several.
    """
    groups = ranked_together(analysis.verdicts)
    scenes: dict[str, list[Group]] = {}
    for key in groups:
        scenes.setdefault(key[0], []).append(key)
    machines = {key[4] for key in groups}
    found = []
    for keys in scenes.values():
        varying = [len(values) > 1 for values in map(set, zip(*keys, strict=True))]
        for key in sorted(keys, key=lambda key: key[3] != "closed"):
            scene, shader, size, division, machine = key
            others = (
                str(shader) * varying[1],
                size * varying[2],
                "open division" * (division != "closed"),
                f"machine {machine}" * (len(machines) > 1),
            )
            found.append(Panel(" ".join(filter(None, [scene, *others])), groups[key]))
    return found


def facets(verdicts: list[Verdict]) -> list[Facet]:
    """One facet if the curves are few; else one for each value of the first axis that splits them well. Divisions are split."""
    if len(divisions := sorted({v.contestant.settings.division for v in verdicts})) > 1:
        return [
            Facet(f"{division} division {facet.title}".strip(), facet.verdicts)
            for division in divisions
            for facet in facets([v for v in verdicts if v.contestant.settings.division == division])
        ]
    if len(verdicts) <= MOST_CURVES:
        return [Facet("", verdicts)]
    for axis in FACET_AXES:
        values = sorted({getattr(v.contestant.settings, axis) for v in verdicts})
        if 2 <= len(values) <= 6:
            return [
                Facet(
                    f"{axis} {brief_choice(value, values) if isinstance(value, Choice) else value}",
                    [v for v in verdicts if getattr(v.contestant.settings, axis) == value],
                )
                for value in values
            ]
    size = math.ceil(len(verdicts) / math.ceil(len(verdicts) / MOST_CURVES))
    return [Facet(f"part {i // size + 1}", verdicts[i : i + size]) for i in range(0, len(verdicts), size)]


def reference_noise(results: Results, panel: Panel) -> tuple[float, int] | None:
    """(relMSE that the reference's own noise amounts to, its spp); None for other metrics or without the reference."""
    if results.metric != results.relative_metric:
        return None
    reference: Reference | None = results.reference(panel.verdicts[0].contestant.done[0].reference_id)
    if reference is None:
        return None
    noise = float((reference.variance / (reference.mean**2 + results.epsilon)).mean())
    return (noise, reference.spp) if math.isfinite(noise) and noise > 0 else None
