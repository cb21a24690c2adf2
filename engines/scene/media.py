"""Media between surfaces: what engines get, and the keys of a scene file. Shapes and cameras name them by index into
`Scene.media`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from engines.scene.triple import Triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import TEXT, ContextKind, Kind, color
from engines.schema.yaml_file import Located

__all__ = ["HomogeneousMedium"]

SIDES = ("interior", "exterior")
"""The sides of a shape that may have a medium: fields of `MediumInterface`, and their names in every format."""


@dataclass(frozen=True, slots=True)
class HomogeneousMedium:
    """The same everywhere: `sigma_t` (1/m), at least 0, is the density of absorption and scattering together, of which the
    share `albedo`, in [0, 1], is scattered. `g` in (-1, 1) is the mean cosine of Henyey and Greenstein's phase function:
    0 is isotropic, above 0 light goes on forwards."""

    name: str
    sigma_t: Triple
    albedo: Triple
    g: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MediumInterface:
    """The media on the two sides of a shape, `exterior` where its front is: places in `Scene.media`, None for vacuum. A shape
    with neither is no boundary of media: rays that leave it stay in the medium where they were."""

    interior: int | None = None
    exterior: int | None = None

    @property
    def is_boundary(self) -> bool:
        """Whether a side has a medium."""
        return self.interior is not None or self.exterior is not None


def _asymmetry(node: Located) -> float:
    value = fields.number(node)
    if not -1.0 < value < 1.0:
        raise node.refuse("must lie between -1 and 1, without these")
    return value


_BETWEEN = {"type": "number", "exclusiveMinimum": -1, "exclusiveMaximum": 1}


def _medium(given: Given, context: Any) -> HomogeneousMedium:
    return HomogeneousMedium(str(given.node.path[-1]), **given.values)


MEDIUM = Record(
    "A homogeneous medium, such as fog, which the shader volumetric_path_tracer renders.",
    {
        "sigma_t": Key(color(), "Extinction coefficient: absorption and scattering together.", unit="1/m"),
        "albedo": Key(color(1), "Share of the extinction that is scattering."),
        "g": Key(Kind(_asymmetry, _BETWEEN), "Mean cosine of scattering (Henyey and Greenstein); 0 is isotropic.", 0),
    },
    _medium,
)


def _named(node: Located, context: Any) -> int:
    """The place of the medium that is named there; `context.media` are their names, in order."""
    return context.media.index(fields.one_of(node, context.media, "medium"))


NAMED_MEDIUM = ContextKind(_named, TEXT.json)
