"""Where files are: scenes by bare name, and the folders within which a scene may read."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike, fspath
from os.path import isfile  # False, where Path.is_file raises for names that are too long
from pathlib import Path

from engines.errors import SceneError, suggestion
from engines.schema.yaml_file import Located

SUFFIXES = (".yaml", ".yml", ".xml")
"""Of scene files: of those with one name, the first is found."""
MESH_SUFFIXES = (".obj", ".ply", ".stl")
GLTF_SUFFIXES = (".glb", ".gltf")
"""Of meshes, and of glTF files, that are scenes by themselves; a bare name finds none of them."""
_ROOT = Path(__file__).resolve().parents[2]


def scene_folders() -> list[Path]:
    """The folders that hold scenes known by bare name: here, of the repository, and of an installed wheel."""
    candidates = (Path("scenes"), _ROOT / "scenes", _ROOT / "harness" / "_shipped" / "scenes")
    return [folder for folder in candidates if folder.is_dir()]


def scene_names() -> list[str]:
    """Bare names of all scenes in `scene_folders`."""
    return sorted({file.stem for folder in scene_folders() for file in folder.iterdir() if file.suffix in SUFFIXES})


def is_xml(path: str | PathLike[str]) -> bool:
    """Whether a name is that of a Mitsuba XML file."""
    return Path(path).suffix.lower() == ".xml"


def names_a_file(name: str) -> bool:
    """Whether a scene's name is that of a file, by its suffix, and not a bare one."""
    return name.lower().endswith((*SUFFIXES, *MESH_SUFFIXES, *GLTF_SUFFIXES))


def find_scene(path: str | PathLike[str]) -> Path:
    """The file of a path, or of a bare name (no folder, no suffix). Raises `SceneError` where there is none."""
    name = fspath(path)
    direct = Path(name)
    bare = direct.name == name and not names_a_file(name)
    if not bare or isfile(direct):
        return direct
    for folder in scene_folders():
        for suffix in SUFFIXES:
            file = folder / (name + suffix)
            if isfile(file):
                return file
    raise SceneError(f"scene {name!r}: unknown scene: {suggestion(name, scene_names())}, or the path of a file")


@dataclass(frozen=True, slots=True)
class Place:
    """The folder that relative paths of a scene start from, whether they may lead out of it, and folders to look in first."""

    folder: Path
    allow_outside: bool = False
    first: tuple[Path, ...] = ()
    _roots: tuple[Path, ...] = field(init=False, repr=False, compare=False)
    """The folders that files may lie in, resolved once: a scene may name tens of thousands of files."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "_roots", tuple(root.resolve() for root in (self.folder, *scene_folders())))

    def find(self, node: Located, name: str, folder: Path | None = None) -> Path:
        """The file that `name`, written at `node`, means.

        It is looked for in the folders `first`, in `folder` (default: the scene's) and in the shipped scenes. Raises when it
        does not exist, or lies outside the scene's folder and the shipped scenes without `allow_outside`; links are followed
        before that.
        """
        what = "" if name == node.value else f"names {name[:80]!r}: "
        starts = [*self.first, folder or self.folder, *scene_folders()]
        outside = False
        for start in starts:
            try:
                file = (start / name).resolve()
                if not (self.allow_outside or any(file.is_relative_to(root) for root in self._roots)):
                    outside = True
                elif file.exists():
                    return file
            except (OSError, ValueError, RuntimeError) as problem:
                raise node.refuse(f"{what}not a usable path: {getattr(problem, 'strerror', None) or problem}") from problem
        if outside:
            remedy = "move it there, or run with --allow-outside"
            raise node.refuse(f"{what}lies outside the scene's folder {self.folder}: {remedy}")
        raise node.refuse(f"{what}no such file: looked in {', '.join(dict.fromkeys(map(str, starts)))}")
