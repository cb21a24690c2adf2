"""Mitsuba's own scene files as they are: film, sampler and integrator are replaced, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.peers.mitsuba import plugins
from engines.peers.mitsuba.library import SCALAR, activate, active, one_line
from engines.peers.mitsuba.nodes import Node
from engines.scene import Scene
from engines.scene.native import NAMES_A_FILE, PLUGIN, Native

LOADING_THREADS = 2
"""At least: with one, Mitsuba 3.9 waits for ever where it decodes large EXR files."""
_FILM = {"pixel_format": "rgb", "component_format": "float32", "sample_border": False}
_UNPASSED = ("config", "filename")
"""Names of parameters that are those of Mitsuba's own function."""


def load(mi: Any, scene: Scene, size: tuple[int, int], sampler: Node, robust: bool) -> Any:
    """Mitsuba's scene of the file that `scene` came from. Raises RuntimeError where Mitsuba does not load it."""
    try:
        loaded = _instantiated(mi, scene.native, size, sampler, robust, optimize=True)
    except RuntimeError as problem:
        if "Mesh::merge()" not in str(problem):
            raise
        # Mitsuba 3.9 tries to make one mesh of those with one BSDF, and fails where flip_normals differs
        loaded = _instantiated(mi, scene.native, size, sampler, robust, optimize=False)
    if not loaded.sensors():
        raise RuntimeError("no sensor")
    return loaded


def _instantiated(mi: Any, held: Native, size: tuple[int, int], sampler: Node, robust: bool, optimize: bool) -> Any:
    """Mitsuba reads the file itself, and only the tree that it makes of it is changed."""
    if wrong := next((name for name in _UNPASSED if name in held.parameters), None):
        raise RuntimeError(f"Mitsuba takes no parameter ${wrong} from outside: give it another name")
    config = mi.parser.ParserConfig(mi.variant())
    config.unused_parameters = mi.LogLevel.Debug
    config.merge_equivalent = config.merge_meshes = optimize
    before = mi.file_resolver()
    looking = mi.FileResolver(before)
    looking.prepend(mi.filesystem.path(str(held.file.parent)))
    mi.set_file_resolver(looking)
    try:
        state = mi.parser.parse_file(config, str(held.file), **held.parameters)
    finally:
        mi.set_file_resolver(before)  # else a folder `plugins` beside the scene would be one of Mitsuba's
    for path in state.files:
        _same(Path(str(path)), held.xml)
    _replace_sensor(mi, state, _film(held, size), sampler)
    state.root.props["embree_use_robust_intersections"] = robust
    _place_files(held, state, mi.parser.ParserState(state), looking)
    mi.parser.transform_all(config, state)
    return mi.parser.instantiate(config, state)


def _film(held: Native, size: tuple[int, int]) -> Node:
    """The properties of a film whose image has this size: the crop of the file's, where it has that one's."""
    sides = {"width": size[0], "height": size[1]}
    return {**(held.film._asdict() if size == held.film.size else sides), **_FILM}


def _replace_sensor(mi: Any, state: Any, film: Node, sampler: Node) -> None:
    """Takes the integrators and all sensors but the first from the scene, and gives that one a `film` and a sampler of ours."""
    kinds, read = mi.ObjectType, mi.parser.ParserState(state)  # a copy: a property counts as used once it has been read
    children = list(_children(read, 0))
    sensors = [(name, index) for name, index in children if state.nodes[index].type == kinds.Sensor]
    if not sensors:
        raise RuntimeError("no sensor")
    for name, index in children:
        kind = state.nodes[index].type
        if kind == kinds.Integrator or (kind == kinds.Sensor and (name, index) != sensors[0]):
            del state.root.props[name]
    first = sensors[0][1]
    for name, index in _children(read, first):
        if state.nodes[index].type in (kinds.Film, kinds.Sampler):
            del state.nodes[first].props[name]
    made = _append(mi, state, kinds.Film, "hdrfilm", film)
    filtered = _append(mi, state, kinds.ReconstructionFilter, "box", {})
    drawn = _append(mi, state, kinds.Sampler, sampler["type"], {key: sampler[key] for key in sampler if key != "type"})
    reference = mi.Properties.ResolvedReference
    state.nodes[made].props["raybench_filter"] = reference(filtered)
    state.nodes[first].props["raybench_film"] = reference(made)
    state.nodes[first].props["raybench_sampler"] = reference(drawn)


def _append(mi: Any, state: Any, kind: Any, plugin: str, properties: Node) -> int:
    node = mi.parser.SceneNode()
    node.type = kind
    node.props.set_plugin_name(plugin)
    for name, value in properties.items():
        node.props[name] = value
    state.nodes.append(node)
    return len(state.nodes) - 1


def _children(state: Any, index: int) -> Iterator[tuple[str, int]]:
    """The nodes within a node, and those that it refers to, by the names of its properties."""
    props = state.nodes[index].props
    for name in list(props.keys()):
        value = props[name]
        if type(value).__name__ == "ResolvedReference":
            yield name, value.index()
        elif type(value).__name__ == "Reference" and value.id() in state.id_to_index:
            yield name, state.id_to_index[value.id()]


def _place_files(held: Native, state: Any, read: Any, looking: Any) -> None:
    """Gives every file that the scene names its path, found as Mitsuba finds it; `read` is a copy of `state`. Raises
    RuntimeError where that is another than raybench has looked up, and for names of plugins that are no words."""
    seen, waiting = {0}, [0]
    while waiting:
        index = waiting.pop()
        props = read.nodes[index].props
        if PLUGIN.fullmatch(props.plugin_name()) is None:
            raise RuntimeError("the name of a plugin must be letters, digits and _, at most 64")
        for name in list(props.keys()):
            text = props[name] if props.type(name) == props.Type.String else ""
            if text and NAMES_A_FILE.search(name):
                state.nodes[index].props[name] = str(_same(Path(str(looking.resolve(text))), held.named))
            elif "/" in text or "\\" in text:
                raise RuntimeError(f"{name} is a path in a property that names no file")
        inner = {child for _, child in _children(read, index)} - seen
        seen |= inner
        waiting += inner


def _same(path: Path, known: frozenset[Path]) -> Path:
    if (file := path.resolve()) not in known:
        raise RuntimeError(f"Mitsuba takes {path}, which is none of the files that raybench has found")
    return file


def size_lacks(held: Native, size: tuple[int, int]) -> str | None:
    """Why an image of the file cannot have this size, or None."""
    if held.film.is_whole or size == held.film.size:
        return None
    width, height = held.film.size
    return f"the film of {held.file.name} is cropped: Mitsuba renders it with {width} x {height} pixels only"


_answers: dict[tuple[str, str, tuple[str, ...]], str | None] = {}


def file_lacks(scene: Scene, variant: str = SCALAR, own: tuple[str, ...] = ()) -> str | None:
    """Why Mitsuba does not load the file that a scene came from, in its own words, or None. Asked once of each content.

    `own` are the plugins of the user's that it may need, see `plugins.register`, in the variant that they are for.
    """
    asked = scene.native.digest, variant, own
    if asked not in _answers:
        with active(variant, LOADING_THREADS):
            plugins.register(own, variant, LOADING_THREADS)
            mi, _ = activate(variant, LOADING_THREADS)
            try:
                load(mi, scene, (16, 16), {"type": "independent", "sample_count": 1}, robust=True)
                _answers[asked] = None
            except Exception as problem:
                _answers[asked] = f"Mitsuba does not load {scene.source}: {one_line(problem)}"
    return _answers[asked]


def require_plugin(kind: str, options: Any, variant: str, own: tuple[str, ...] = ()) -> Any:
    """The integrator or sampler, by `kind`, of a shader or sampler `mitsuba`, in a variant with plugins `own`. Raises
    `ConfigError` in Mitsuba's words where it makes none."""
    setting = {"Integrator": "shader", "Sampler": "sampler"}[kind]
    with active(variant, 1):
        plugins.register(own, variant, 1)
        mi, _ = activate(variant, 1)
        try:
            made = mi.load_dict(plugins.node(options))
        except Exception as problem:
            raise ConfigError(f"{setting} mitsuba: {one_line(problem)}") from problem
        if not isinstance(made, getattr(mi, kind)):
            raise ConfigError(f"{setting} mitsuba.type = {options['type']!r}: is no {kind.lower()} of Mitsuba's")
        return made
