"""Draws the gallery: python docs/pictures/gallery.py [SCENE ...] renders scenes (default: all) and writes docs/gallery.md.

The words about a scene are the comment on top of its file; the pictures are what the command beside each makes. Those of
furnished scenes are kept as JPEG files, the small ones as PNG files.
"""

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parents[1]
SCENES = DOCS.parent / "scenes"
PICTURES = DOCS / "pictures" / "gallery"
HEAD = """# Gallery

Every YAML file in `scenes/`, rendered by the path tracer. Commands and configs name a scene by its bare name. Not shown:
`scenes/mobilert/`, three scenes whose meshes are not ours to ship and a variant of `mobilert_cornell`; `scenes/scaling/`, a
ball of triangles and a sphereflake, each in five sizes; and `scenes/lantern.xml`, a scene in Mitsuba's format. `python
docs/pictures/gallery.py` makes all pictures.
"""
FURNISHED = {
    "living_room": 256,
    "study": 1024,
    "hall": 96,
    "classroom": 96,
    "meadow": 4,
    "cafe": 1024,
    "workshop": 256,
    "cabinet": 256,
    "still_life": 1024,
    "bathroom": 256,
    "desk_lamp": 256,
}
"""Samples per pixel of the scenes that are drawn in full size, 1280 x 720, in the order of the page."""
SAMPLES = {
    "cornell_spheres": 1024,
    "glassware": 384,
    "many_lights": 1024,
    "metals": 1024,
    "mobilert_cornell": 16,
    "door": 2048,
    "mobilert_cornell2": 2048,
}
"""Of the others, where it is not 256."""
OPTIONS = {
    "door": ["--shader", "{name: path_tracer, guiding: sd_tree}", "--tone-mapper", "reinhard", "--exposure", "5"],
    "mobilert_cornell": ["--engine", "numpy", "--shader", "whitted"],
}
"""Of pictures that are made in another way: hardly any light passes the door; the other's light hangs a centimetre below the
ceiling, and no path finds that spot in time."""
COLUMNS = 4
TEST_SCENES = """## Test scenes

{}

The small pictures are made by commands like this one, with the samples per pixel of the table,
{}.

```console with --engine numba --precision float64 --size 48x32 --spp 2 -o cornell_box.png
$ {}
```

| scene | what it is | samples |
| --- | --- | ---: |
{}

The port of Dahlquist's own program draws this picture of `dahlquist`, equal to the original's byte for byte. Behind the balls
it has an image where the path tracer sees the sky:

![the port](pictures/gallery/dahlquist_port.png)

```console no-run: tests/dahlquist draws it at another size
$ {}
```
"""
PORT_COMMAND = "raybench render dahlquist --size 160x160 --calls 11 --probe smooth --engine numpy -o dahlquist_port.png"


def command(name: str) -> list[str]:
    width, height = map(int, re.findall(r"resolution: \[(\d+), (\d+)\]", (SCENES / f"{name}.yaml").read_text())[0])
    size = "1280x720" if name in FURNISHED else f"{160 * width // height}x160"
    options = OPTIONS.get(name, [])
    how = [] if "--engine" in options else ["--engine", "numba" if name in FURNISHED else "embree", "--precision", "float32"]
    spp = str({**SAMPLES, **FURNISHED}.get(name, 256))
    return ["raybench", "render", name, *how, *options, "--spp", spp, "--size", size, "-o", f"{name}.png"]


def words(name: str) -> str:
    """The comment on top of a scene's file."""
    lines = (SCENES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    return " ".join(line.lstrip("# ") for line in lines[: next(i for i, line in enumerate(lines) if line[:1] != "#")])


def furnished(name: str) -> str:
    fence = "console no-run: a picture of this size takes minutes"
    picture = f"![{name}](pictures/gallery/{name}.jpg)"
    return f"## {name}\n\n{picture}\n\n{words(name)}\n\n```{fence}\n$ {' '.join(command(name))}\n```\n"


def test_scenes(names: list[str]) -> str:
    """A grid of pictures above their names, and what each scene is."""
    rows = []
    for start in range(0, len(names), COLUMNS):
        row = names[start : start + COLUMNS]
        pictures = [f"![{name}](pictures/gallery/{name}.png)" for name in row]
        rows += [pictures, *([[":---:"] * COLUMNS] if start == 0 else []), [f"`{name}`" for name in row]]
    grid = "\n".join("| " + " | ".join(row + [""] * (COLUMNS - len(row))) + " |" for row in rows)
    table = "\n".join(f"| `{name}` | {words(name)} | {SAMPLES.get(name, 256)} |" for name in names)
    others = ", and\n".join(f"`{name}` with `{shlex.join(options)}`" for name, options in OPTIONS.items())
    return TEST_SCENES.format(grid, others, " ".join(command("cornell_box")), table, PORT_COMMAND)


def draw(line: list[str]) -> None:
    target = line[-1]
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / target
        subprocess.run([sys.executable, "-m", "harness", *line[1:-1], str(made)], cwd=DOCS.parent, check=True)
        keep(made)


def keep(made: Path) -> None:
    """Put a rendered PNG file into the gallery, as a JPEG file if its scene is a furnished one."""
    picture = Image.open(made).convert("RGB")
    if made.stem in FURNISHED:
        picture.save(PICTURES / f"{made.stem}.jpg", quality=90, subsampling=0, optimize=True)
    else:
        picture.save(PICTURES / made.name, optimize=True)


def main(wanted: list[str]) -> None:
    names = sorted(file.stem for file in SCENES.glob("*.yaml"))
    page = [HEAD, *map(furnished, FURNISHED), test_scenes([name for name in names if name not in FURNISHED])]
    (DOCS / "gallery.md").write_text("\n".join(page), encoding="utf-8")
    PICTURES.mkdir(exist_ok=True)
    for name in wanted or names:
        draw(command(name))
        if name == "dahlquist":
            draw(PORT_COMMAND.split())


if __name__ == "__main__":
    main(sys.argv[1:])
