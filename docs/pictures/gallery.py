"""Draws the gallery: python docs/pictures/gallery.py [SCENE ...] renders scenes (default: all) and writes docs/gallery.md.

The words about a scene are the comment on top of its file; the pictures are what the command beside each makes.
"""

import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
SCENES = DOCS.parent / "scenes"
PICTURES = DOCS / "pictures" / "gallery"
HEAD = """# Gallery

Every scene that comes with raybench, by the path tracer where no other shader is named. A scene is named by its bare name
in commands and configs; the three in `scenes/mobilert/` need a mesh that is not ours to ship, and say so where it is missing.
`scenes/scaling/` has a ball of triangles and a sphereflake, each in five sizes. All pictures:
`python docs/pictures/gallery.py`.
"""
SAMPLES = {
    "cornell_spheres": 1024, "glassware": 384, "many_lights": 1024, "metals": 1024, "mobilert_cornell": 16,
    "mobilert_cornell2": 2048,
}  # fmt: skip
FURNISHED = ("bathroom", "cabinet", "cafe", "desk_lamp", "living_room", "still_life", "workshop")
"""Drawn in full size, 1280 x 720."""
FURNISHED_SAMPLES = 1024
SHADERS = {"mobilert_cornell": "whitted"}
"""Whose picture is by another shader: its light hangs a centimetre below the ceiling, and no path finds that spot in time."""

NOTES = {"furnace": "\nThe picture is white, as it has to be: every pixel is 1.\n"}

PORT = """
What Dahlquist's own program draws of it, byte for byte, with a picture behind the balls where other engines see the sky:

![the port](pictures/gallery/dahlquist_port.png)

```console no-run: tests/dahlquist draws it at another size
$ {}
```
"""
PORT_PICTURE = "docs/pictures/gallery/dahlquist_port.png"
PORT_COMMAND = f"raybench dahlquist --size 160x160 --calls 11 --probe smooth --engine numpy -o {PORT_PICTURE}"


def command(name: str) -> list[str]:
    width, height = map(int, re.findall(r"resolution: \[(\d+), (\d+)\]", (SCENES / f"{name}.yaml").read_text())[0])
    size = f"{width}x{height}" if name in FURNISHED else f"{160 * width // height}x160"
    target = f"docs/pictures/gallery/{name}.png"
    how = ["--engine", "embree", "--precision", "float32"]
    if name in SHADERS:
        how = ["--engine", "numpy", "--shader", SHADERS[name]]
    spp = str(FURNISHED_SAMPLES if name in FURNISHED else SAMPLES.get(name, 256))
    return ["raybench", "render", name, *how, "--spp", spp, "--size", size, "-o", target]


def words(name: str) -> str:
    """The comment on top of a scene's file."""
    lines = (SCENES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    return " ".join(line.lstrip("# ") for line in lines[: next(i for i, line in enumerate(lines) if line[:1] != "#")])


def marked(name: str) -> str:
    """What the fence of a scene's command says to the tests: one of them is run, small."""
    if name == "cornell_box":
        return "with --engine numba --precision float64 --size 48x32 --spp 2 -o cornell_box.png"
    if name in FURNISHED:
        return "no-run: a picture of this size takes from minutes to an hour"
    return "no-run: tests/mitsuba/test_agreement.py renders every shipped scene with the engine embree"


def entry(name: str) -> str:
    more = PORT.format(PORT_COMMAND) if name == "dahlquist" else ""
    more += NOTES.get(name, "")
    picture = f"![{name}](pictures/gallery/{name}.png)"
    return f"## {name}\n\n{picture}\n\n{words(name)}\n\n```console {marked(name)}\n$ {' '.join(command(name))}\n```\n{more}"


def main(wanted: list[str]) -> None:
    names = sorted(file.stem for file in SCENES.glob("*.yaml"))
    (DOCS / "gallery.md").write_text("\n".join([HEAD, *map(entry, names)]), encoding="utf-8")
    PICTURES.mkdir(exist_ok=True)
    commands = [command(name) for name in wanted or names]
    if "dahlquist" in (wanted or names):
        commands.append(PORT_COMMAND.split())
    for words_of_one in commands:
        subprocess.run([sys.executable, "-m", "harness", *words_of_one[1:]], cwd=DOCS.parent, check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
