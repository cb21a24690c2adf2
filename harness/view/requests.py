"""What a page may ask of its worker, checked: limits on size, threads and samples, and no key that is not known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from engines.errors import ConfigError
from harness.measure import machine

LARGEST_SIDE = 4096
MOST_PIXELS = 1 << 22
MOST_SPP = 1 << 20
MOST_LANES = 4
LONGEST = 300


def _named(choice: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(choice.get("name"), str):
        raise ValueError("the key 'name' is wanted")
    return choice


Text = Annotated[str, Field(min_length=1, max_length=LONGEST)]
Side = Annotated[int, Field(ge=1, le=LARGEST_SIDE)]
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Choice = Annotated[dict[str, Any], Field(max_length=20), AfterValidator(_named)]
Finger = Annotated[int, Field(ge=0, le=20)]


class Request(BaseModel):
    """A message of a page; `do` chose its class in `KINDS`, `seq` numbers those that make work."""

    model_config = ConfigDict(extra="forbid")
    do: str
    seq: int = 0


class Part(BaseModel):
    """Who renders, and how."""

    model_config = ConfigDict(extra="forbid")
    engine: Text
    shader: Choice
    sampler: Choice
    accelerator: Choice
    threads: Annotated[int, Field(ge=1, le=1024)]
    precision: Literal["float32", "float64"] | None = None


class Open(Request):
    """Begins an image anew; sizes default to the scene's. `keep` keeps the camera and what was dragged."""

    scene: Text
    part: Part
    width: Side | None = None
    height: Side | None = None
    spp: Annotated[int, Field(ge=1, le=MOST_SPP)] = 256
    seed: Annotated[int, Field(ge=0, le=2**32)] = 1
    keep: bool = False


class View(Request):
    """A camera; `height` is that of an orthographic window."""

    eye: Point
    target: Point
    up: Point
    height: Annotated[float, Field(gt=0, le=1e9)] | None = None


class Grab(Request):
    """What lies under a pixel, or the thing of a name, is to be dragged."""

    x: Number = 0.0
    y: Number = 0.0
    id: Text | None = None


class Drag(Request):
    id: Text
    x: Number
    y: Number


class Probe(Request):
    x: Annotated[int, Field(ge=0, lt=LARGEST_SIDE)]
    y: Annotated[int, Field(ge=0, lt=LARGEST_SIDE)]


class Tone(Request):
    mapper: Text
    exposure: Annotated[float, Field(ge=-20, le=20)] = 0.0


class Save(Request):
    """An image as a file, or a race under a name."""

    kind: Literal["exr", "png"] = "exr"
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")] = "race"


class Race(Request):
    scene: Text
    lanes: Annotated[list[Part], Field(min_length=2, max_length=MOST_LANES)]
    width: Annotated[int, Field(ge=8, le=1024)]
    height: Annotated[int, Field(ge=8, le=1024)]
    targets: Annotated[list[Annotated[float, Field(gt=0, le=1e6)]], Field(min_length=1, max_length=6)]
    reference_spp: Annotated[int, Field(ge=2, le=MOST_SPP)] = 1024
    reference_engine: Text = "embree"
    max_seconds: Annotated[float, Field(gt=0, le=3600)] = 20.0
    slice_seconds: Annotated[float, Field(ge=0.05, le=10)] = 0.5
    seed: Annotated[int, Field(ge=0, le=8999)] = 1


class Demo(Request):
    width: Annotated[int, Field(ge=16, le=2048)]
    height: Annotated[int, Field(ge=16, le=2048)]
    engine: Literal["numba", "numpy"] = "numba"
    threads: Annotated[int, Field(ge=1, le=1024)]


class Switches(Request):
    reflections: bool = True
    environment: bool = True
    interlaced: bool = True
    redraw: bool = False
    speed: Annotated[int, Field(ge=0, le=100)] = 8


class Touch(Request):
    finger: Finger = 0
    x: Number = 0.0
    y: Number = 0.0


class Hold(Request):
    """A ball by its number, held by a finger that begins at its middle."""

    finger: Finger
    ball: Annotated[int, Field(ge=0, le=4)]


class Plain(Request):
    """A request that says all by its name."""


KINDS: dict[str, type[Request]] = {
    "open": Open, "camera": View, "grab": Grab, "drag": Drag, "probe": Probe, "tone": Tone, "save": Save, "race": Race,
    "demo": Demo, "hold": Hold, "switches": Switches, "touch": Touch, "move": Touch, "release": Touch, "stop": Plain,
    "resume": Plain, "yaml": Plain, "ack": Plain,
}  # fmt: skip


def checked(given: Mapping[str, Any]) -> Any:
    """The request that a page's message is. Raises `ConfigError` that names what is wrong."""
    kind = KINDS.get(str(given.get("do")))
    if kind is None:
        raise ConfigError(f"unknown request {given.get('do')!r}")
    try:
        found = kind.model_validate(given)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(step) for step in first["loc"])
        raise ConfigError(f"{place or given['do']}: {first['msg']}") from error
    if isinstance(found, Open) and (found.width or 1) * (found.height or 1) > MOST_PIXELS:
        raise ConfigError(f"{found.width}x{found.height}: more than {MOST_PIXELS} pixels")
    return found


def threads_within(asked: int) -> int:
    """As many threads as there are cores, at most."""
    return min(asked, len(machine.usable_cores()))
