"""What a measuring worker is asked for: films, or answers to rays. The pool that asks fills `allow_imports` and `scratch` in,
the file in which the worker leaves them."""

from __future__ import annotations

from typing import NamedTuple

from engines.interface import FullPattern
from harness.config.settings import SceneFile
from harness.measure.schedule import Schedule
from harness.settings import CellSettings, TracerSettings


class CellRequest(NamedTuple):
    """To measure a cell that renders, with `seed`, after a pass that does not count with `warm_up_seed`."""

    scene: SceneFile
    scene_hash: str
    settings: CellSettings
    seed: int
    warm_up_seed: int
    schedule: Schedule
    patterns: tuple[FullPattern, ...] = ()
    allow_imports: bool = False
    scratch: str = ""


class RayRequest(NamedTuple):
    """To measure a cell that traces the rays of a kind in `file`: all of them, `batch` a call (None: in one), until
    `max_time_seconds` are on the clock. Answers to `checked` of them and to `hard` ones beside are left."""

    scene: SceneFile
    scene_hash: str
    settings: TracerSettings
    file: str
    kind: str
    batch: int | None
    max_time_seconds: float
    checked: int
    hard: int
    allow_imports: bool = False
    scratch: str = ""


class ReferenceRequest(NamedTuple):
    """To render `spp` samples per pixel under each of the seeds."""

    scene: SceneFile
    scene_hash: str
    settings: CellSettings
    spp: int
    seeds: tuple[int, ...] = ()
    allow_imports: bool = False
    scratch: str = ""


ImageRequest = CellRequest | ReferenceRequest
Request = ImageRequest | RayRequest
