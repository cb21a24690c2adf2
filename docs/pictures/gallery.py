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
FENCE = "console no-run: a picture of this size takes minutes"
HEAD = """# Gallery

This page shows the scenes in `scenes/` that you can name without a path, and `watch.glb`. Choose a scene by its purpose:

- a first comparison in seconds: `cornell_box`, `two_spheres`
- comparing numba, Mitsuba, LuxCore and Cycles: `study`, whose materials all four support
- timing in furnished rooms: `living_room`, `hall`, `classroom`
- light sampling: `many_lights`, `veach_plates`; path guiding: `door`
- accelerators: `teapot_stadium` and Haines' scenes (`gears`, `lattice`, `mount`, `rings`, `sphereflake`, `tetra`, `tree`)
- materials: metals in `metals` and `workshop`, glass in `glassware` and `cabinet`, `principled` in `still_life`, masks in
  `living_room` and `desk_lamp`, bump and normal maps in `workshop`
- correctness: `furnace`, in which every pixel is 1
- media: `dusty_room`, `milk`; instances: `meadow`, with 3,800,000 triangles; glTF: `watch.glb`

The comment on top of a scene's file says more. Scenes for which this page names no source were made for raybench. `scenes/`
also contains `lantern.xml`, a Mitsuba scene, and the folders `mobilert`, `scaling` (two scenes in five sizes) and
`disagreements` ([scenes on which renderers differ](how/where_renderers_differ.md)).

## Furnished scenes

Captions give the samples per pixel. This command makes the first picture:

```{}
$ {}
```
"""
FURNISHED = {
    "living_room": 256,
    "study": 1024,
    "hall": 96,
    "classroom": 96,
    "meadow": 24,
    "cafe": 1024,
    "workshop": 256,
    "cabinet": 256,
    "still_life": 1024,
    "bathroom": 256,
    "desk_lamp": 256,
    "dusty_room": 128,
    "milk": 256,
    "watch": 64,
}
"""Samples per pixel of the scenes that are drawn in full size, 1280 x 720, in the order of the page. Their captions end at the
first colon: the pictures show the rest."""
GLTF = {"watch": "A wrist watch on a leather strap, a glTF file with the camera and the lamps of a product photograph."}
"""What such a file shows: it has no comment."""
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
    "dusty_room": ["--shader", "{name: volumetric_path_tracer, max_depth: 2, light_sampler: power}"],
    "milk": ["--shader", "{name: volumetric_path_tracer, max_depth: 64, rr_depth: 64}"],
}
"""Of pictures that are made in another way: two show media; hardly any light passes the door; that of mobilert_cornell hangs a
centimetre below the ceiling, and no path finds that spot in time."""
TEST_SCENES = """## Test scenes

| scene | content |
| :---: | --- |
{}

Most of these pictures have 256 samples per pixel. `docs/pictures/gallery.py` makes all of them. Its command for the first is:

```console with --engine numba --precision float64 --size 48x32 --spp 2 -o cornell_box.png
$ {}
```

raybench's port of Dahlquist's program draws this picture of `dahlquist`, byte for byte equal to the original. Its background
is an image; the path tracer shows a sky instead:

![the port](pictures/gallery/dahlquist_port.png)

```console no-run: tests/dahlquist draws it at another size
$ {}
```
"""
PORT_COMMAND = "raybench render dahlquist --size 160x160 --calls 11 --probe smooth --engine numpy -o dahlquist_port.png"


def command(name: str) -> list[str]:
    size = "1280x720" if name in FURNISHED else small_size(name)
    scene = f"scenes/{name}.glb" if name in GLTF else name
    options = OPTIONS.get(name, [])
    how = [] if "--engine" in options else ["--engine", "numba" if name in FURNISHED else "embree", "--precision", "float32"]
    spp = str({**SAMPLES, **FURNISHED}.get(name, 256))
    return ["raybench", "render", scene, *how, *options, "--spp", spp, "--size", size, "-o", f"{name}.png"]


def small_size(name: str) -> str:
    """160 pixels high, with the aspect ratio of the scene."""
    width, height = map(int, re.findall(r"resolution: \[(\d+), (\d+)\]", (SCENES / f"{name}.yaml").read_text())[0])
    return f"{160 * width // height}x160"


def words(name: str) -> str:
    """The first sentence of the comment on top of a scene's file."""
    if name in GLTF:
        return GLTF[name]
    lines = (SCENES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    text = " ".join(line.lstrip("# ") for line in lines[: next(i for i, line in enumerate(lines) if line[:1] != "#")])
    return re.split(r"(?<=[a-z0-9)])\. (?=[A-Z0-9])", text)[0].removesuffix(".") + "."


def furnished(name: str) -> str:
    picture = f"![{name}](pictures/gallery/{name}.jpg)"
    caption = words(name).split(": ")[0].removesuffix(".")
    own = f"\n```{FENCE}\n$ {shlex.join(command(name))}\n```\n" if name in OPTIONS else ""
    return f"### {name}\n\n{picture}\n\n{caption}. {FURNISHED[name]} samples.\n{own}"


def test_scenes(names: list[str]) -> str:
    """A table of pictures and of what each scene is."""
    rows = [f"| ![{name}](pictures/gallery/{name}.png)<br>`{name}` | {words(name)} |" for name in names]
    return TEST_SCENES.format("\n".join(rows), " ".join(command("cornell_box")), PORT_COMMAND)


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


def page(names: list[str]) -> str:
    head = HEAD.format(FENCE, " ".join(command(next(iter(FURNISHED)))))
    return "\n".join([head, *map(furnished, FURNISHED), test_scenes([name for name in names if name not in FURNISHED])])


def main(wanted: list[str]) -> None:
    names = sorted([*GLTF, *(file.stem for file in SCENES.glob("*.yaml"))])
    (DOCS / "gallery.md").write_text(page(names), encoding="utf-8")
    PICTURES.mkdir(exist_ok=True)
    for name in wanted or names:
        draw(command(name))
        if name == "dahlquist":
            draw(PORT_COMMAND.split())


if __name__ == "__main__":
    main(sys.argv[1:])
