"""The JSON schema of experiment files, for editors that complete and check YAML."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from engines.choices import SAMPLERS, SHADERS
from engines.registry import known_names
from harness.config.descriptions import DESCRIPTIONS
from harness.config.experiment import (
    IMAGES,
    METRICS,
    SECTIONS,
    TOP_DEFAULTS,
    TOP_KEYS,
    Checkpoints,
    Quality,
    ReferenceConfig,
    VerifyConfig,
)
from harness.config.filters import COMPARISONS
from harness.config.settings import DEFAULTS, SETTING_READERS, Budget, samplers_of_engines
from harness.config.validators import UNITS

_TIME = {"type": "string", "pattern": r"^\s*([0-9]+(\.[0-9]*)?|\.[0-9]+)\s*(ms|s|m|min|h)\s*$"}
_SIZE = {"type": "string", "pattern": rf"^\s*([0-9]+(\.[0-9]*)?|\.[0-9]+)\s*({'|'.join(UNITS)})\s*$"}
_SEED = {"type": "integer", "minimum": 0}


def experiment_schema() -> dict[str, Any]:
    """A draft 2020-12 schema, with a sentence on every key and its default.

    It is no stricter than `harness.config`, which has the last word.
    """
    settings = _described(_settings())
    anything = {key: {} for key in settings}
    together = _object({key: {"type": "array", "minItems": 1, "items": value} for key, value in settings.items()})
    sections: dict[str, Any] = {
        "matrix": together,
        "zip": {"anyOf": [together, {"type": "array", "items": together}]},
        "exclude": {"type": "array", "items": _object(_conditions(anything))},
        "include": {"type": "array", "items": _object(settings)},
        "extend": {
            "type": "array",
            "items": _object({"where": _object(_conditions(anything)), "set": _object(settings)}, ["where", "set"]),
        },
        "checkpoints": _object({
            "ratio": {"type": "number", "minimum": 1.01}, "start": {"type": "integer", "minimum": 1},
        }),
        "limits": _object({"memory": _SIZE}),
        "order": _object({"policy": {"enum": ["blocks"]}, "seed": _SEED}),
        "reference": _object({
            "engine": settings["engine"], "spp": {"type": "integer", "minimum": 2}, "seed": _SEED,
            "sampler": settings["sampler"], "accelerator": settings["accelerator"],
            "precision": settings["precision"], "threads": {"type": "integer", "minimum": 0},
            "certify": {"anyOf": [settings["engine"], {"const": None}]},
        }),
        "quality": _object({
            "metric": {"enum": list(METRICS)}, "epsilon": {"type": "number", "exclusiveMinimum": 0},
            "targets": {"oneOf": [{"const": "auto"}, {"type": "array", "items": {"type": "number"}, "minItems": 1}]},
        }),
        "verify": _object({
            "cases": {"type": "array", "items": {"type": "string"}, "minItems": 1}, "quick": {"type": "boolean"},
            "timeout": _TIME,
        }),
    }  # fmt: skip
    scalars: dict[str, Any] = {
        "raybench_experiment": {"const": 1}, "name": {"type": ["string", "number"]},
        "question": {"type": ["string", "number"]},
        "repeats": {"type": "integer", "minimum": 1, "maximum": 1000}, "seed": _SEED, "aa_twin": {"type": "boolean"},
        "timing": {"type": "boolean"}, "images": {"enum": list(IMAGES)}, "baseline": {"type": ["string", "null"]},
    }  # fmt: skip
    known = {**_described(scalars | sections), **settings}
    assert set(known) == set(TOP_KEYS) and set(sections) == set(SECTIONS)
    top = _object(known, ["raybench_experiment"])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "raybench experiment",
        **top, "patternProperties": {r"^\.": {}},
    }  # fmt: skip


def _described(properties: dict[str, Any], path: str = "") -> dict[str, Any]:
    """The properties of the object at `path`, and of those inside, with what `DESCRIPTIONS` and the defaults say of them."""
    found, defaults = {}, _defaults()
    for name, schema in properties.items():
        where = path + name
        if any(key.startswith(f"{where}.") for key in DESCRIPTIONS):
            inner = schema.get("items", schema)
            inner["properties"] = _described(inner["properties"], f"{where}.")
        found[name] = {**schema, "description": DESCRIPTIONS[where]}
        if where in defaults:
            found[name]["default"] = defaults[where]
    return found


def _defaults() -> dict[str, Any]:
    """By path, as a file would write them."""
    sections = {"checkpoints": Checkpoints(), "reference": ReferenceConfig(), "quality": Quality(),
                "verify": VerifyConfig(), "budget": Budget()}  # fmt: skip
    found: dict[str, Any] = {key: value for key, value in DEFAULTS.items() if value is not None} | dict(TOP_DEFAULTS)
    for section, default in sections.items():
        for key, value in asdict(default).items():
            plain = list(value) if isinstance(value, tuple) else value
            if key.endswith("_seconds"):
                found[f"{section}.{key.removesuffix('_seconds')}"] = f"{value:g}s"
            elif plain is not None:
                found[f"{section}.{key}"] = plain
    return found


def _object(properties: dict[str, Any], required: list[str] | None = None) -> dict[str, Any]:
    found: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    return {**found, "required": required} if required else found


def _choice(names: list[str]) -> dict[str, Any]:
    name = {"anyOf": [{"enum": names}, {"type": "string", "pattern": ":"}]} if names else {"type": "string"}
    return {"anyOf": [name, {"type": "object", "required": ["name"], "properties": {"name": name}}]}


def _settings() -> dict[str, Any]:
    found: dict[str, Any] = {
        "scene": {"type": "string"},
        "engine": {"anyOf": [{"enum": known_names()}, {"type": "string", "pattern": r":|\.ya?ml$"}]},
        "shader": _choice(sorted(SHADERS)),
        "sampler": _choice(sorted({*SAMPLERS, *samplers_of_engines()})),
        "accelerator": _choice([]),
        "precision": {"enum": ["float64", "float32", None]},
        "threads": {"type": "integer", "minimum": 1, "maximum": 1024},
        "resolution": {
            "type": "array", "items": {"type": "integer", "minimum": 1, "maximum": 65536}, "minItems": 2, "maxItems": 2,
        },
        "budget": _object({"max_time": _TIME, "max_spp": {"type": "integer", "minimum": 1}, "timeout": _TIME}),
    }  # fmt: skip
    assert set(found) == set(SETTING_READERS)
    return found


def _conditions(keys: dict[str, Any]) -> dict[str, Any]:
    bounds = _object({name: {"type": "number"} for name in COMPARISONS})
    numbers = {"anyOf": [{"type": "integer"}, {"type": "array"}, bounds]}
    return {key: numbers if key == "threads" else value for key, value in keys.items() if key != "budget"}
