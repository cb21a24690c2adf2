"""What engines say of scenes and settings before anything runs. One that fails at it is told of by name."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from engines import choices
from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, UnknownName
from engines.interface import Engine
from engines.scene import Scene
from harness.measure import tracing
from harness.settings import CellSettings, TracerSettings, engine_settings, plugin_or_choice

REPRODUCIBLE = ("seeds_matter", "a_split_render_is_the_same")
"""Claims of `engines.conformance` that make an image a function of seed and samples."""


def accelerators(engine: Engine) -> Mapping[str, Any]:
    """Its accelerators with their options, `auto` among them. Raises `ConfigError` where it cannot list them."""
    try:
        found: Any = engine.accelerators()
    except RaybenchError:
        raise
    except (Exception, SystemExit) as error:
        message = f"engine {engine.name}: accelerators failed: {type(error).__name__}: {error}"
        raise ConfigError(message) from error
    if not isinstance(found, Mapping) or not all(isinstance(options, Mapping) for options in found.values()):
        raise ConfigError(
            f"engine {engine.name}: accelerators returned {found!r}: a mapping from names to mappings of options is expected"
        )
    return {"auto": {}, **found}


def resolved(engine: Engine, given: Choice) -> Choice:
    """An accelerator of the engine with all of its options. Raises where it has none such."""
    return choices.resolve("accelerator", given, accelerators(engine))


def resolves(engine: Engine, given: Choice) -> bool:
    """Whether the engine has such an accelerator."""
    try:
        resolved(engine, given)
    except RaybenchError:
        return False
    return True


def precision(engine: Engine, scene: Scene, settings: CellSettings, allow_imports: bool) -> str:
    """The precision where the config has none: float64, the same for all engines, but for one that has float32 alone."""
    double = replace(settings, precision="float64")
    single = replace(settings, precision="float32")
    able = why_not(engine, scene, double, allow_imports) is None
    return "float64" if able or why_not(engine, scene, single, allow_imports) else "float32"


def is_smooth(engine: Engine, sampler: Choice, allow_imports: bool) -> bool:
    """Whether the error falls smoothly with every sample: as the plugin says, the engine, or the sampler's name."""
    if ":" in sampler.name:
        made = plugin_or_choice("sampler", sampler, allow_imports)
        return getattr(getattr(made, "plugin", made), "smooth", False) is True
    return sampler.name in getattr(engine, "smooth_samplers", choices.SMOOTH_SAMPLERS)


def is_reproducible(engine: Engine) -> bool:
    """Whether the engine promises that seed and samples decide an image."""
    broken: Any = getattr(engine, "not_promised", {})
    return isinstance(broken, Mapping) and not any(claim in broken for claim in REPRODUCIBLE)


def auto_accelerator(engine: Engine, scene: Scene, settings: CellSettings, allow_imports: bool) -> str:
    """What the engine says of its choice where the accelerator is `auto`; empty where it says nothing, or fails at it."""
    says = getattr(engine, "auto_accelerator", None)
    if settings.accelerator.name != "auto" or not callable(says):
        return ""
    try:
        return str(says(scene, engine_settings(settings, 0, allow_imports)))
    except (Exception, SystemExit) as error:
        message = f"engine {engine.name}: auto_accelerator failed: {type(error).__name__}: {error}"
        warnings.warn(message, stacklevel=2)
        return ""


def why_not(engine: Engine, scene: Scene, settings: CellSettings, allow_imports: bool) -> str | None:
    """The engine's answer. One that fails at it, or answers something else, is tried: the cell will show."""
    plain = engine_settings(settings, 0, allow_imports)
    return _answer(engine, scene, lambda: engine.why_not(scene, plain))


def why_no_tracer(engine: Engine, scene: Scene, settings: TracerSettings, allow_imports: bool) -> str | None:
    """Why the engine cannot trace single rays in a scene, or None, as in `why_not`."""
    try:
        return _answer(engine, scene, lambda: tracing.why_not(engine, scene, settings, allow_imports))
    except RaybenchError as error:
        return str(error)


def _answer(engine: Engine, scene: Scene, ask: Callable[[], Any]) -> str | None:
    if scene.native is not None and scene.native.refusal and not getattr(engine, "takes_native", False):
        return scene.native.refusal
    try:
        answer = ask()
    except UnknownName as unknown:
        if unknown.kind in ("sampler", "shader"):  # an engine's own, which the configuration was right to name
            return f"the engine {engine.name} has no {unknown.kind} {unknown.found}"
        raise
    except RaybenchError:
        raise
    except (Exception, SystemExit) as error:
        warnings.warn(f"engine {engine.name}: why_not failed: {type(error).__name__}: {error}: it is tried", stacklevel=2)
        return None
    if answer is not None and not isinstance(answer, str):
        warnings.warn(
            f"engine {engine.name}: why_not answered {answer!r}: None or a sentence is expected: it is tried", stacklevel=2
        )
        return None
    return answer
