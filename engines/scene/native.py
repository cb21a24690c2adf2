"""A Mitsuba scene file as it is, for the engines that take one: the files that it names, and their hash.

Mitsuba reads files and loads plugins by their names. So every name of a file is looked up here, within the folders that a
scene may read, and Mitsuba may read no other; and the name of a plugin is a word, never a path.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from engines.errors import SceneError
from engines.input_files import open_regular, unreadable
from engines.scene.cameras import Perspective
from engines.scene.mitsuba_xml.document import Document, Element
from engines.scene.mitsuba_xml.properties import plugin_tree, snake_case
from engines.scene.mitsuba_xml.sensors import Film, film_of
from engines.scene.scene import Scene

CHUNK = 1 << 20
PLUGIN = re.compile(r"[A-Za-z0-9_]{1,64}")
NAMES_A_FILE = re.compile(r"file|path", re.IGNORECASE)
_OF_SENSORS = ("film", "sampler")


@dataclass(frozen=True, slots=True, eq=False)
class Native:
    """A file in Mitsuba's own format. `refusal` says why raybench cannot import it, None where it can.

    `xml` are the paths of all XML files, the included ones too, `named` those of the files that they name: the only ones that
    Mitsuba may read. `parameters` are values of `$name` from outside, `film` is that of the first sensor. `digest` is a
    hash of the elements as they stand in the files, of the parameters and of the files that are named.
    """

    file: Path
    parameters: Mapping[str, str]
    xml: frozenset[Path]
    named: frozenset[Path]
    digest: str
    film: Film
    refusal: str | None = None


def native(document: Document, refusal: str | None = None) -> Native:
    """The file of a document. Raises `SceneError` for what Mitsuba must not be given: names that are no plugin's, files that
    are not there or lie outside, and scenes without a sensor."""
    sensors = [child for child in document.root.children if child.tag == "sensor"]
    if not sensors:
        raise document.root.refuse("has no sensor")
    named: dict[Path, None] = {}
    hashed = hashlib.sha256(f"mitsuba scene 2 {document.digest}".encode())
    for element in _walk(document.root):
        if PLUGIN.fullmatch(element.attributes.get("type", "scene")) is None:
            raise element.refuse("the name of a plugin must be letters, digits and _, at most 64")
        if (name := _named_file(element)) is not None:
            file = document.place.find(element.located(name), name)
            if file not in named:
                hashed.update(_hash_of(file, element))
            named[file] = None
    return Native(
        document.file.absolute(),
        document.parameters,
        frozenset(document.files),
        frozenset(named),
        hashed.hexdigest(),
        _film(sensors[0]),
        refusal,
    )


def with_file(document: Document, imported: Callable[[], Scene], natively: bool) -> Scene:
    """The imported scene with its file. Where `imported` refuses, with `natively`, a scene that has nothing but the file: a
    name, a size, and the refusal. What Mitsuba must not be given is imported alone, with a warning: an unused texture may be
    missing. Raises `SceneError`."""
    try:
        scene = imported()
    except SceneError as problem:
        if not natively:
            raise
        return _unimported(document, native(document, str(problem)))
    try:
        return replace(scene, native=native(document))
    except SceneError as problem:
        said = f"Mitsuba's engines get what raybench imported, not the file: {problem}"
        return replace(scene, warnings=(*scene.warnings, said))


def _unimported(document: Document, found: Native) -> Scene:
    camera = Perspective((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), 40.0, "y", found.film.size)
    warnings = (f"only engines that take Mitsuba's files as they are render it: {found.refusal}",)
    name, source, shader = document.file.stem, str(document.file), _integrator(document.root)
    return Scene(name, camera, (), (), (), found.digest, source, warnings, shader, found)


def _integrator(root: Element) -> dict[str, Any] | None:
    """The file's integrator as a shader of Mitsuba's; None where it is not a plain one."""
    element = next((child for child in root.children if child.tag == "integrator"), None)
    if element is None or not {child.tag for child in element.children} <= {"integer", "float", "boolean"}:
        return None
    kinds = {"integer": int, "float": float, "boolean": lambda text: text.strip().lower() == "true"}
    try:
        options = {child.required("name"): kinds[child.tag](child.required("value")) for child in element.children}
    except ValueError:
        return None
    return {"name": "mitsuba", "type": element.required("type"), **{snake_case(name): value for name, value in options.items()}}


def _walk(element: Element) -> Iterator[Element]:
    """All elements but films and samplers, which the engine replaces by its own."""
    yield element
    for child in element.children:
        if child.tag not in _OF_SENSORS:
            yield from _walk(child)


def _named_file(element: Element) -> str | None:
    """The name of a file that an element gives, as it is written. Raises `SceneError` for other strings that look like one."""
    if element.tag == "spectrum":
        return element.attributes.get("filename")
    if element.tag != "string":
        return None
    text = element.attributes.get("value", "")
    if NAMES_A_FILE.search(element.attributes.get("name", "")):
        return text
    if "/" in text or "\\" in text:
        raise element.refuse_value("is a path in a property that names no file")
    return None


def _hash_of(file: Path, element: Element) -> bytes:
    hashed = hashlib.sha256()
    try:
        with open_regular(file) as stream:
            while chunk := stream.read(CHUNK):
                hashed.update(chunk)
    except (OSError, ValueError) as problem:
        raise element.refuse_value(str(unreadable(problem))) from problem
    return hashed.digest()


def _film(sensor: Element) -> Film:
    """Of what else stands in a film Mitsuba is the judge."""
    film = next((child for child in sensor.children if child.tag == "film"), None)
    if film is None:
        return Film()
    sides = {snake_case(child.attributes.get("name", "")): child for child in film.children if child.tag == "integer"}
    return film_of(plugin_tree(replace(film, children=list(sides.values())), {}))
