"""What an archive holds beside results, so that others can measure them again and cite them: the experiment, its scenes, how to
replay it, and citation metadata."""

from __future__ import annotations

import copy
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from engines.errors import ConfigError, RaybenchError
from engines.input_files import files_opened
from engines.registry import is_file
from engines.scene import load_scene
from engines.schema.yaml_file import yaml_text
from harness.config import paths
from harness.store import atomic
from harness.store.records import Manifest
from harness.store.results import Results

EXPERIMENT, README, CITATION, SCENES = "experiment.yaml", "README.md", "CITATION.cff", "scenes"
FILES = (EXPERIMENT, README, SCENES)
"""What is written anew with every archive. A citation that its authors have filled in stays."""
REPOSITORY_LICENCE = "MIT"
SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")


class Published(NamedTuple):
    """What authors say of an archive: their names, as `Family, Given` or as they are; the SPDX identifier of the licence of the
    data, "" for none; and whether the files of scenes go with it."""

    authors: Sequence[str] = ()
    licence: str = ""
    scenes: bool = True

    def check(self) -> None:
        """Raises `ConfigError` for what is no licence identifier or no name."""
        if self.licence and not SPDX.fullmatch(self.licence):
            raise ConfigError(f"--license {self.licence}: an SPDX identifier is expected, as CC-BY-4.0")
        for author in self.authors:
            if not author.strip() or not author.isprintable():
                raise ConfigError(f"--author {author!r}: a name is expected, as 'Kajiya, James'")


UNSIGNED = Published()


def write_supplement(results: Results, manifest: Manifest, out: Path, published: Published) -> list[str]:
    """Writes the files of `FILES`, and the citation where there is none or something is given for it.

    `manifest` is that of the archive. Returns sentences on what the archive lacks.
    """
    config, missing = _experiment(results, manifest, out, published.scenes)
    atomic.write_text(out / EXPERIMENT, yaml_text(config))
    if published.authors or published.licence or not (out / CITATION).exists():
        atomic.write_text(out / CITATION, citation(results, manifest, published))
    atomic.write_text(out / README, readme(results, manifest, missing, published))
    return missing


def clear_supplement(out: Path) -> None:
    """Removes what `write_supplement` writes anew."""
    for name in FILES:
        path = out / name
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)


def _experiment(results: Results, manifest: Manifest, out: Path, with_scenes: bool) -> tuple[dict[str, Any], list[str]]:
    """The experiment as a file in the archive; scenes that do not come with raybench are copied and named there."""
    config = copy.deepcopy(manifest.config)
    named = [entry.get("scene") for entry in results.manifest.config.get("include", ())]
    replaced: dict[str, str] = {}
    missing = []
    for scene in {json.dumps(name): name for name in named}.values():
        given, parameters = (scene, {}) if isinstance(scene, str) else (scene["file"], scene.get("parameters", {}))
        if (known := paths.shipped_file(SCENES, given)) is not None and paths.comes_with_raybench(known):
            continue
        copied = _copied_scene(results, given, parameters, out) if with_scenes else "left out"
        if isinstance(copied, Path):
            replaced[given] = copied.as_posix()
        else:
            missing.append(f"The scene {Path(given).name} is not here: {copied}.")
    for entry, scene in zip(config.get("include", ()), named, strict=True):
        if isinstance(scene, str):
            entry["scene"] = replaced.get(scene, entry["scene"])
        elif scene is not None:
            entry["scene"]["file"] = replaced.get(scene["file"], entry["scene"]["file"])
    engines = {entry["engine"] for entry in config.get("include", ())}
    choices = [entry.get(key) for entry in config.get("include", ()) for key in ("shader", "sampler", "accelerator")]
    names = {choice.get(key) for choice in choices if isinstance(choice, dict) for key in ("name", "plugin")}
    own = sorted(name for name in engines | names if isinstance(name, str) and ":" in name)
    if own:
        missing.append(f"The code of {', '.join(own)} is not here: put it beside {EXPERIMENT}.")
    if described := sorted(filter(is_file, engines)):
        missing.append(f"{', '.join(described)} and the program that it calls are not here: put them beside {EXPERIMENT}.")
    return config, missing


def _copied_scene(results: Results, given: str, parameters: Mapping[str, Any], out: Path) -> Path | str:
    """The path of a copy in the archive, with all that it reads, or why there is none."""
    try:
        source = paths.find(SCENES, given)
        with files_opened() as opened:
            scene = load_scene(source, parameters={key: str(value) for key, value in parameters.items()}, natively=True)
    except RaybenchError as error:
        return str(error).replace(str(Path.cwd()), ".")
    names = {source.stem, source.name, given}
    # A cell names a scene with its parameters: `room depth=3`.
    of_cells = {(f"{Path(cell.scene).name} ", cell.scene_hash) for cell in results.all_cells}
    recorded = {identity for shown, identity in of_cells if any(shown.startswith(f"{name} ") for name in names)}
    if recorded and scene.identity not in recorded:
        return "its file has changed since it was measured"
    read = {source.resolve(), *opened, *(scene.native.xml | scene.native.named if scene.native else ())}
    root, place = source.resolve().parent, Path(SCENES) / source.stem
    for path in read:
        if path.is_relative_to(root):
            target = out / place / path.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        elif not paths.comes_with_raybench(path):
            shutil.rmtree(out / place, ignore_errors=True)
            return "it reads files outside of its folder"
    return place / source.name


def citation(results: Results, manifest: Manifest, published: Published) -> str:
    """Citation metadata in the Citation File Format 1.2.0; without authors it names none, as reviewers may not see any."""
    machine = manifest.machine
    software = {"type": "software", "title": "raybench", "authors": [{"name": "The raybench developers"}]}
    software |= {"license": REPOSITORY_LICENCE, **({"version": str(machine["raybench"])} if machine.get("raybench") else {})}
    if commit := (machine.get("git") or {}).get("commit"):
        software["commit"] = commit
    found = {
        "cff-version": "1.2.0",
        "message": "If you use these measurements, please cite them, and the software that made them.",
        "type": "dataset",
        "title": f"Measurements of {_name(results)}",
        "authors": [_person(name) for name in published.authors] or [{"name": "Anonymous"}],
        **({"license": published.licence} if published.licence else {}),
        **({"date-released": manifest.time[:10]} if manifest.time else {}),
        "keywords": ["rendering", "benchmark", *results.scenes],
        "references": [software],
    }
    return yaml_text(found)


def _person(name: str) -> dict[str, str]:
    family, comma, given = (part.strip() for part in name.partition(","))
    return {"family-names": family, "given-names": given} if comma and given else {"name": name.strip()}


def readme(results: Results, manifest: Manifest, missing: Sequence[str], published: Published) -> str:
    """What is in the archive, what it was measured on, and how to replay it."""
    machine, git = manifest.machine, manifest.machine.get("git") or {}
    measured = [
        f"- processor: {machine['cpu']}" if machine.get("cpu") else "",
        f"- system: {machine.get('system', '')} {machine.get('kernel', '')}".rstrip() if machine.get("system") else "",
        f"- Python {machine['python']}" if machine.get("python") else "",
        f"- raybench {machine['raybench']}" if machine.get("raybench") else "",
        f"- commit {git['commit']}{', with changes that are in no commit' if git.get('dirty') else ''}"
        if git.get("commit")
        else "",
        *(f"- {name} {version}" for name, version in machine.get("libraries", {}).items()),
        *(f"- engine {engine} {version}" for engine, version in sorted(_engine_versions(results))),
    ]
    licence = (
        f"The measurements are under {published.licence}."
        if published.licence
        else ("No licence is given for the measurements: ask their authors.")
    )
    lines = [
        f"# Measurements of {_name(results)}",
        "",
        results.config.question or "Which contestant reaches a given error first?",
        "",
        f"Scenes: {', '.join(results.scenes)}. Engines: {', '.join(results.engines)}. {len(results.cells)} cells, made by",
        f"`{' '.join(manifest.command)}`." if manifest.command else "raybench.",
        "",
        "## Replay",
        "",
        "With raybench installed, at the version or commit below,",
        "",
        "    raybench replay FOLDER",
        "",
        "measures all of this folder again on your machine, and says which images and ratios of times came out again.",
        *(["", *missing] if missing else []),
        "",
        "    raybench report FOLDER",
        "",
        "draws tables, plots and `report.html` from the measurements, without rendering.",
        "",
        "## Files",
        "",
        f"- `{EXPERIMENT}`: the experiment with every default filled in",
        f"- `{SCENES}/`: scenes that do not come with raybench, where it is there",
        "- `manifest.json`: command, machine and versions",
        "- `events.jsonl.gz`: every measurement, one a line",
        "- `references/`: the converged images with their variance",
        "- `images/`: the images that the report shows",
        f"- `{CITATION}`: how to cite this",
        "",
        "## Measured with",
        "",
        *filter(None, measured),
        "",
        "## Licence",
        "",
        f"{licence} Scenes have licences of their own. raybench is under {REPOSITORY_LICENCE}.",
    ]
    return "\n".join(lines) + "\n"


def _name(results: Results) -> str:
    return results.config.name or results.folder.name


def _engine_versions(results: Results) -> set[tuple[str, str]]:
    return {(cell.engine, cell.engine_version) for cell in results.cells if cell.engine_version}
