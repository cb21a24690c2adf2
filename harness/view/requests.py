"""Requests of pages, validated: limits on size, threads and samples; unknown keys are refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from engines.errors import ConfigError
from harness.measure import machine

MAX_SIDE = 4096
MAX_PIXELS = 1 << 22
MAX_SPP = 1 << 20
MAX_CONTESTANTS = 4
MAX_TEXT = 300


def _named(choice: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(choice.get("name"), str):
        raise ValueError("the key 'name' is missing")
    return choice


Text = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]
Side = Annotated[int, Field(ge=1, le=MAX_SIDE)]
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Choice = Annotated[dict[str, Any], Field(max_length=20), AfterValidator(_named)]
Finger = Annotated[int, Field(ge=0, le=20)]


class Request(BaseModel):
    """A message of a page. `type` is its key in `REQUESTS`; `seq` numbers the requests that start rendering."""

    model_config = ConfigDict(extra="forbid")
    type: str
    seq: int = 0


class RenderSettings(BaseModel):
    """The engine and its settings."""

    model_config = ConfigDict(extra="forbid")
    engine: Text
    shader: Choice
    sampler: Choice
    accelerator: Choice
    threads: Annotated[int, Field(ge=1, le=1024)]
    precision: Literal["float32", "float64"] | None = None


class OpenRequest(Request):
    """Starts an image; sizes default to those of the scene. `keep_edits` keeps the camera and the moved objects."""

    scene: Text
    settings: RenderSettings
    width: Side | None = None
    height: Side | None = None
    spp: Annotated[int, Field(ge=1, le=MAX_SPP)] = 256
    seed: Annotated[int, Field(ge=0, le=2**32)] = 1
    keep_edits: bool = False


class CameraRequest(Request):
    """A new camera pose; `height` is the window height of an orthographic camera, in metres."""

    eye: Point
    target: Point
    up: Point
    height: Annotated[float, Field(gt=0, le=1e9)] | None = None


class PickRequest(Request):
    """Picks the object under a pixel, or the one with this id, to be dragged."""

    x: Number = 0.0
    y: Number = 0.0
    id: Text | None = None


class DragRequest(Request):
    id: Text
    x: Number
    y: Number


class ProbeRequest(Request):
    x: Annotated[int, Field(ge=0, lt=MAX_SIDE)]
    y: Annotated[int, Field(ge=0, lt=MAX_SIDE)]


class ToneRequest(Request):
    """How the film is displayed: tone mapped, or as an error map against the reference."""

    show: Literal["image", "error"] = "image"
    mapper: Text
    exposure: Annotated[float, Field(ge=-20, le=20)] = 0.0


class ReferenceRequest(Request):
    """Sets the reference of the error map: an EXR file below the folder, or else the image as it is."""

    file: Text | None = None


class SaveRequest(Request):
    """Saves an image as a file of this kind, or a race under this name."""

    kind: Literal["exr", "png"] = "exr"
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")] = "race"


class RaceRequest(Request):
    scene: Text
    contestants: Annotated[list[RenderSettings], Field(min_length=2, max_length=MAX_CONTESTANTS)]
    width: Annotated[int, Field(ge=8, le=1024)]
    height: Annotated[int, Field(ge=8, le=1024)]
    targets: Annotated[list[Annotated[float, Field(gt=0, le=1e6)]], Field(min_length=1, max_length=6)]
    reference_spp: Annotated[int, Field(ge=2, le=MAX_SPP)] = 1024
    reference_engine: Text = "embree"
    max_seconds: Annotated[float, Field(gt=0, le=3600)] = 20.0
    slice_seconds: Annotated[float, Field(ge=0.05, le=10)] = 0.5
    seed: Annotated[int, Field(ge=0, le=8999)] = 1


class DahlquistRequest(Request):
    width: Annotated[int, Field(ge=16, le=2048)]
    height: Annotated[int, Field(ge=16, le=2048)]
    engine: Literal["numba", "numpy"] = "numba"
    threads: Annotated[int, Field(ge=1, le=1024)]


class SwitchesRequest(Request):
    reflections: bool = True
    environment: bool = True
    interlaced: bool = False
    redraw: bool = False
    speed: Annotated[int, Field(ge=0, le=100)] = 8


class TouchRequest(Request):
    finger: Finger = 0
    x: Number = 0.0
    y: Number = 0.0


class HoldRequest(Request):
    """Holds a sphere of Dahlquist's program, by index, at its centre."""

    finger: Finger
    sphere: Annotated[int, Field(ge=0, le=4)]


class PlainRequest(Request):
    """A request without fields."""


REQUESTS: dict[str, type[Request]] = {
    "open": OpenRequest,
    "camera": CameraRequest,
    "pick": PickRequest,
    "drag": DragRequest,
    "probe": ProbeRequest,
    "tone": ToneRequest,
    "reference": ReferenceRequest,
    "save": SaveRequest,
    "race": RaceRequest,
    "dahlquist": DahlquistRequest,
    "hold": HoldRequest,
    "switches": SwitchesRequest,
    "touch": TouchRequest,
    "move": TouchRequest,
    "release": TouchRequest,
    "stop": PlainRequest,
    "resume": PlainRequest,
    "yaml": PlainRequest,
    "ack": PlainRequest,
}


def checked(message: Mapping[str, Any]) -> Any:
    """The request in a page's message. Raises `ConfigError` that names the key and what is wrong with it."""
    kind = REQUESTS.get(str(message.get("type")))
    if kind is None:
        raise ConfigError(f"unknown request {message.get('type')!r}")
    try:
        request = kind.model_validate(message)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(step) for step in first["loc"])
        raise ConfigError(f"{place or message['type']}: {first['msg']}") from error
    if isinstance(request, OpenRequest) and (request.width or 1) * (request.height or 1) > MAX_PIXELS:
        raise ConfigError(f"{request.width}x{request.height}: more than {MAX_PIXELS} pixels")
    return request


def limited_threads(threads: int) -> int:
    """The number of threads, at most that of usable cores."""
    return min(threads, len(machine.usable_cores()))
