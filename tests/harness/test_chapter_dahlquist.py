"""The chapter's section about Dahlquist's ray tracer says what the numbers and the images say."""

import json
import re

import numpy as np
import pytest

import engines
from engines import Settings, dahlquist
from engines.film import Film
from engines.image import write_image
from harness.config.settings import SceneFile
from harness.report.chapter import figures, write_chapter
from harness.run import references
from harness.store.events import line_of
from tests.harness.synthetic import Size, base_cell, manifest, reference_asked

SIZE = Size(40, 40)
NAMES = (("dahlquist", "area_hierarchy"), ("numba", "bvh"), ("embree", "embree"))


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """Spares the drawing, which takes most of the time."""
    monkeypatch.setattr(figures, "save", lambda figure, plots, name, formats: "<svg></svg>")


@pytest.fixture(scope="module")
def frame():
    """The port's frame (40, 40, 3) over 255, and where it shows spheres."""
    tracer = dahlquist.Tracer(*SIZE, engine="numpy", probe=dahlquist.smooth_probe())
    for _ in range(10):
        tracer.animation.step(3000)
    drawn = tracer.call(3000).copy()
    return drawn[..., :3] / 255.0, drawn[..., 3] == dahlquist.SPHERE


def cell(name, seconds, block, threads=2, image=None):
    engine, accelerator = name
    made = base_cell(("dahlquist", engine, accelerator, "constant", threads, None), block, SIZE)
    points = [{"spp": n, "seconds": n * seconds, "rays": 1600 * n, "metrics": {}, "image": image} for n in (1, 4)]
    return made | {"shader": {"name": "whitted", "max_depth": 6}, "points": points}


def cells(seconds, noise=0.001, threads=2):
    """Four blocks, each with a drift of its own and a little noise."""
    return [
        cell(name, time * (1 + 0.05 * block) * (1 + noise * (-1) ** (block + i)), block, threads)
        for block in range(4)
        for i, (name, time) in enumerate(zip(NAMES, seconds, strict=True))
    ]


def chapter(folder, made, reference=None, cell_ids=()):
    folder.mkdir(exist_ok=True)
    twins = [each | {"label": "A/A", "cell_id": each["cell_id"] + "-twin"} for each in made if each["engine"] == "embree"]
    events = [*made, *twins]
    if reference is not None:
        asked = reference_asked("dahlquist", SIZE)
        wanted = references.PlannedReference(SceneFile("dahlquist", "dahlquist"), "sdahlquist", asked, {})
        film = Film(*SIZE)
        for _ in range(2):
            film.add(reference)
        references._save(wanted.folder(folder / "references"), wanted, film, 1.0)
        events.append(json.loads(line_of(references.event(wanted, folder / "references"))))
    told = manifest()
    told["config"]["name"] = "dahlquist"
    (folder / "manifest.json").write_text(json.dumps(told | {"cell_ids": list(cell_ids)}))
    (folder / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return write_chapter([folder], folder / "chapter")[0].read_text().replace("\\", "")


def test_turned_times_turn_the_ratios(tmp_path):
    port_ahead = chapter(tmp_path / "a", cells((0.01, 0.02, 0.04)))
    assert re.search(r"\| numba bvh \| 2 \|.*\| 0\.500 \[", port_ahead) and "## Beside Dahlquist's ray tracer" in port_ahead
    port_behind = chapter(tmp_path / "b", cells((0.04, 0.02, 0.01)))
    assert re.search(r"\| numba bvh \| 2 \|.*\| 2(\.00)? \[", port_behind)


def test_frame_times_rays_and_gains_are_those_measured(tmp_path):
    text = chapter(tmp_path, [*cells((0.01, 0.02, 0.04)), *cells((0.016, 0.02, 0.08), threads=1)])
    row = {tuple(line.split(" | ")[:2]): line for line in text.splitlines() if line.startswith("| ")}
    one, two = row["| dahlquist area_hierarchy", "1"], row["| dahlquist area_hierarchy", "2"]
    assert "| 17.2 [" in one and "| 10.7 [" in two, "milliseconds, in the middle of the blocks' drift"
    assert "| 0.149 [" in two, "1600 rays in 10.73 ms are 0.149 million a second"
    assert re.search(r"\| 1\.60 \[1\.\d+, 1\.6\d*\] \|$", two) and one.endswith("| – |")


def test_the_port_not_measured_is_said(tmp_path):
    text = chapter(tmp_path, [made for made in cells((0.01, 0.02, 0.03)) if made["engine"] != "dahlquist"])
    assert re.search(r"\| numba bvh \| 2 \| [^|]+ \| [^|]+ \| – \| – \|", text), "nothing is compared with it"


def test_cells_not_measured_are_said(tmp_path):
    failed = cell(("numba", "grid"), 1.0, 0) | {"state": "failed", "message": "out of rods", "points": []}
    measured = cells((0.01, 0.02, 0.04))
    asked = [*(made["cell_id"] for made in (*measured, failed)), "never-begun"]
    text = chapter(tmp_path, [*measured, failed], cell_ids=asked)
    assert re.search(r"\| numba grid \| 2 \| – \| – \| – \| – \|", text)
    assert "failed, out of rods." in text and "1 cell of the experiment had not been begun." in text


def test_nothing_measured_is_said(tmp_path):
    text = chapter(tmp_path, [made | {"state": "timeout", "points": []} for made in cells((1, 1, 1))])
    assert "Nothing was measured." in text and "### Frames" not in text


def test_images_are_compared_on_spheres_alone(tmp_path, frame):
    port, spheres = frame
    shifted, elsewhere = port.copy(), port.copy()
    shifted[spheres] = np.clip(np.where(port[spheres] > 0.5, port[spheres] - 20 / 255, port[spheres] + 20 / 255), 0, 1)
    elsewhere[~spheres] = 0.5
    images = dict(zip(NAMES, (port, shifted, elsewhere), strict=True))
    made = []
    for name, image in images.items():
        write_image(tmp_path / f"{name[0]}.exr", image)
        made += [cell(name, 0.01, block, image=f"{name[0]}.exr") for block in range(2)]
    text = chapter(tmp_path, made, reference=port)
    assert f"over the {spheres.sum()} pixels" in text
    for same in ("dahlquist area_hierarchy", "embree"):
        assert f"| {same} | 0 | 0 | 0 | 0 % |" in text
    assert re.search(r"\| numba bvh \| 20(\.0)? \| 20(\.0)? \| 20(\.0)? \| 100 % \|", text)


def test_images_are_not_compared_with_another_reference(tmp_path, frame):
    text = chapter(tmp_path, cells((0.01, 0.02, 0.03)), reference=frame[0][::-1])
    assert "Images were not compared: the reference is not the frame that the port draws of its scene." in text
    assert "levels of 255" not in text


def test_images_that_were_not_kept_are_said(tmp_path, frame):
    missing = chapter(tmp_path / "a", cells((0.01, 0.02, 0.03)))
    assert "Images were not compared: the reference is missing." in missing
    unkept = chapter(tmp_path / "b", cells((0.01, 0.02, 0.03)), reference=frame[0])
    assert "No image was kept of dahlquist area_hierarchy, embree and numba bvh." in unkept


def test_features_are_those_of_the_code(tmp_path):
    text = chapter(tmp_path, cells((0.01, 0.02, 0.04)))
    port = engines.engine("dahlquist")
    scene = engines.load_scene("scenes/two_spheres.yaml")
    assert f"| scenes | {port.why_not(scene, Settings())} | any scene of raybench's format |" in text
    row = next(line for line in text.splitlines() if line.startswith("| accelerators |"))
    names = {*port.accelerators(), *engines.engine("numba").accelerators()} - {"auto", "none"}
    assert all(name in row for name in (*names, "brute force"))
    assert "dahlquist: area_hierarchy (brute force)" in row and "numba: bvh (" in row, "raced, and what else there is"
    assert "as many as max_depth allows, here 6" in text
