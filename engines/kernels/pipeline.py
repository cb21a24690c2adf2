"""The table of the stages: which ones a scene and its integrator need, and what compiles them. `driver` calls them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels.compile.second_process import Job
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.stages import camera, flight, guiding, light, material, sampler, scattering, shade, surface, transmit
from engines.scene import Camera, ThinLens

SAMPLING = ("sampling",)


class Stages(NamedTuple):
    """Addresses of compiled stages, in the order of calls; 0 of those that are not needed."""

    draw_pixel: int = 0
    camera: int = 0
    draw_flight: int = 0
    """In scenes with media, as `flight`, `arrival` and, where shadow rays do not cross null lobes, `attenuation`."""
    flight: int = 0
    closest: int = 0
    surface: int = 0
    arrival: int = 0
    draw_vertex: int = 0
    material: int = 0
    """Where some material has wrappers or textures. It takes draws of the vertex."""
    sampling: NDArray[np.int64] = np.zeros(0, np.int64)
    """The light sample; the BSDFs, where they have stages of their own; around them, the two stages of guided paths."""
    shade: int = 0
    attenuation: int = 0
    occluded: int = 0
    dark_surface: int = 0
    """Where shadow rays cross null lobes, as `transmit`."""
    transmit: int = 0


class Plan(NamedTuple):
    """What the driver does for a scene and its integrator, besides calling stages."""

    branches: bool = False
    """Two rays may follow from one hit."""
    lit: bool = False
    """There are lights to sample."""
    null_lobes: bool = False
    """Shadow rays cross null lobes."""
    media: bool = False
    """There are media."""
    guided: bool = False
    """Directions are sampled by an SD-tree as well, and recorded for it."""
    per_vertex: int = 1
    """Light samples at a vertex."""
    last_depth: int = 0
    """See `stages.shade.last_depth`."""


class Accelerator(Protocol):
    """What finds hits: builds its arrays into the flattened scene and gives the stages that walk them."""

    name: str
    scratch: int
    precision: Any
    """Scalar type in which it traces, or None for that of the batch."""
    build_seconds: float

    @property
    def bytes(self) -> int: ...

    def build(self, flat: FlatScene, threads: int) -> None: ...

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]: ...


class StageConfig(NamedTuple):
    """What stages are compiled for."""

    features: SceneFeatures
    shader: Choice
    sampler: Choice
    camera: Camera
    accelerator: Accelerator
    real: Any

    @property
    def null_lobes(self) -> bool:
        """Shadow rays cross null lobes."""
        return self.features.transparent and self.shading.lit

    @property
    def shading(self) -> shade.ShadeFeatures:
        return shade.shade_features(shade.integrator_of(self.shader), self.features)


class Group(NamedTuple):
    """Stages that are made together."""

    fields: tuple[str, ...]
    """Of `Stages`, one for each stage; groups of `sampling` have any number of stages, which are called in this order."""
    make: Callable[[], Sequence[Any]]
    """Compiles or loads the stages."""
    cost: int = 0
    """Groups of a higher cost are compiled before others."""


def table(config: StageConfig) -> Iterator[Group]:
    """The stages that a scene and its integrator need."""
    features, shading, real = config.features, config.shading, config.real
    integrator = shade.integrator_of(config.shader)
    uses, resampled = shade.uses(integrator, shading), shade.light_candidates(config.shader) > 1
    yield Group(
        ("draw_pixel", "draw_vertex"), lambda: sampler.stages(config.sampler, real, isinstance(config.camera, ThinLens))
    )
    yield Group(("camera",), lambda: [camera.stage(config.camera, real)])
    yield Group(("closest", "occluded"), lambda: config.accelerator.stages(features, real), 7)
    yield Group(("surface",), lambda: [surface.stage(features, real)], 8)
    if features.media:
        yield Group(("draw_flight", "flight"), lambda: [sampler.flight_stage(config.sampler, real), flight.flight_stage(real)])
        yield Group(("arrival",), lambda: [flight.arrival_stage(features.hidden_emitters, real)])
    if features.programs and any(uses):
        yield Group(("material",), lambda: [material.stage(features, real)], 4)
    if shading.lit:
        yield Group(SAMPLING, lambda: [light.stage(features, shading.every, resampled, real)], 5)
    if features.guided:
        yield Group(SAMPLING, lambda: [guiding.choose_stage(features, real)], 3)
    yield Group(SAMPLING, lambda: scattering.stages(features, uses, real), 6)
    if features.guided:
        yield Group(SAMPLING, lambda: [guiding.mix_stage(features.masks, shading.lit, real)], 3)
    yield Group(("shade",), lambda: [shade.stage(integrator, shading, features, real)], 9)
    if features.media and shading.lit and not config.null_lobes:
        yield Group(("attenuation",), lambda: [flight.attenuation_stage(real)])
    if config.null_lobes:
        yield Group(
            ("dark_surface", "transmit"), lambda: (surface.dark_stage(features, real), transmit.stage(features, real)), 3
        )


def ray_table(config: StageConfig) -> Iterator[Group]:
    """The stages that single rays need."""
    yield Group(("closest", "occluded"), lambda: config.accelerator.stages(config.features, config.real))
    yield Group(("surface",), lambda: [surface.bare_stage(config.features, config.real)])


def jobs(groups: Iterable[Group]) -> list[Job]:
    """What compiles or loads the stages of a table, the costly ones first."""
    return [group.make for group in sorted(groups, key=lambda group: group.cost, reverse=True)]


def stages(groups: Iterable[Group]) -> tuple[Stages, list[Any]]:
    """The stages of a table, compiled or loaded: (their addresses, what keeps their machine code alive)."""
    addresses, several, kept = dict[str, int](), list[int](), list[Any]()
    for group in groups:
        made = group.make()
        kept += made
        if group.fields == SAMPLING:
            several += [stage.address for stage in made]
        else:
            addresses |= {field: stage.address for field, stage in zip(group.fields, made, strict=True)}
    return Stages(**addresses, sampling=np.array(several, np.int64)), kept


def plan(config: StageConfig, n_lights: int) -> Plan:
    """The plan for a scene of so many listed lights."""
    features, shading = config.features, config.shading
    return Plan(
        branches=shading.branches,
        lit=shading.lit,
        null_lobes=config.null_lobes,
        media=features.media,
        guided=features.guided,
        per_vertex=max(n_lights, 1) if shading.every else 1,
        last_depth=shade.last_depth(config.shader, features),
    )
