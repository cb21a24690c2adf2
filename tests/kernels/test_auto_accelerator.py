"""`accelerator: auto` of numba: what the counts of a scene predict, and what is said of it."""

import pytest

import engines
from engines.numba_cpu.accel.choice import COSTS, Counts, choose, counts_of, predicted
from harness import config
from harness.plan import planner


def test_counts_are_those_of_the_scene():
    assert counts_of(engines.load_scene("two_spheres")) == (26, 2, 0)
    assert counts_of(engines.load_scene("metals")) == (0, 8, 2)
    assert counts_of(engines.load_scene("many_lights")) == (48, 375, 0)
    assert counts_of(engines.load_scene("mobilert_spheres")) == (1, 1, 0)


@pytest.mark.parametrize("precision", COSTS)
@pytest.mark.parametrize("kind", range(3))
def test_the_list_is_taken_up_to_one_count_and_the_tree_beyond(precision, kind):
    wanted = []
    for n in (0, 1, 4, 16, 64, 128, 256, 1024, 10**6):
        of_list, of_tree = predicted(Counts(*(n if k == kind else 0 for k in range(3))), COSTS[precision])
        wanted.append(of_list <= of_tree)
    assert wanted == sorted(wanted, reverse=True)
    assert wanted[3] and not wanted[-2]


@pytest.mark.parametrize(("name", "taken"), [("cornell_box", "none"), ("many_lights", "bvh")])
def test_auto_takes_what_it_says(name, taken):
    scene = engines.load_scene(name)
    settings = engines.Settings(8, 8, precision="float32")
    engine = engines.engine("numba")
    assert choose(scene, "float32")[0] == taken
    assert engine.auto_accelerator(scene, settings).startswith(f"{taken} (")
    renderer = engine.prepare(scene, settings)
    assert renderer._accelerator.name == taken
    assert renderer.counters()["accelerator_bytes"] == 0 or taken == "bvh"


def test_a_plan_says_what_auto_takes_and_why(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(
        "raybench_experiment: 1\nname: small\nquestion: Which?\nresolution: [8, 8]\nshader: albedo\n"
        "matrix: {scene: [cornell_box], engine: [numba, embree], accelerator: [auto, none]}\n"
        "budget: {max_time: 1s, max_spp: 8, timeout: 1m}\nquality: {targets: [0.1]}\n"
    )
    cells = planner.make(config.load(str(file))).cells
    said = {(cell.engine_name, cell.settings.accelerator.name): cell.auto_accelerator for cell in cells if not cell.skip}
    assert said["numba", "auto"].startswith("none (36 triangles; predicted ns per ray: none ")
    assert said["numba", "none"] == "" and said["embree", "auto"] == ""
    assert all("auto_accelerator" not in cell.spec for cell in cells)
