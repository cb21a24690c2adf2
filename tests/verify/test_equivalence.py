"""`raybench equivalence` on rendered images: planted faults are found, and an engine equals itself.

False alarms are counted by simulation in tests/harness/test_statistics_equivalence.py; seeds here are fixed.
"""

import numpy as np
import pytest
from typer.testing import CliRunner

import engines
from harness.cli import app
from harness.statistics.equivalence import Margins, equivalence
from tests.image_tests import image_tests
from tests.verify.mutated import FAULTS, mutated

SETTINGS = {
    "width": 32,
    "height": 32,
    "shader": {"name": "path_tracer", "max_depth": 3},
    "sampler": "random",
    "seed": 1,
    "spp": 64,
}
LOOSE = Margins(0.02, 0.2)


def two_lamps():
    emitter = {"emission": 4, "two_sided": True}
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "two emitters",
            "camera": {"type": "perspective", "eye": [0, 2, 6], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 40},
            "materials": {"white": {"kd": 0.7}, "emitter": emitter},
            "shapes": [
                {"plane": {"point": [0, 0, 0], "normal": [0, 1, 0]}, "material": "white"},
                {"sphere": {"center": [0, 0.7, 0], "radius": 0.7}, "material": "white"},
                {"sphere": {"center": [-2, 3, 1], "radius": 0.5}, "material": "emitter"},
                {"sphere": {"center": [2, 3, 1], "radius": 0.5}, "material": "emitter"},
            ],
        }
    )


def replicate_images(engine, scene, settings, replicates, first):
    """(replicates, height, width, 3) images with seeds of their own, rendered here."""
    plain = {key: value for key, value in settings.items() if key not in ("spp", "seed")}
    seeds = [settings["seed"] + first + k for k in range(replicates)]
    renderers = (engine.prepare(scene, engines.Settings(**plain, seed=seed)) for seed in seeds)
    return np.stack([np.array(renderer.render(settings["spp"]).mean()) for renderer in renderers])


@pytest.fixture(scope="module")
def truth():
    return replicate_images(engines.engine("numpy"), two_lamps(), SETTINGS, 12, 0)


@pytest.fixture(scope="module")
def again():
    """Images of the same engine with other seeds."""
    return replicate_images(engines.engine("numpy"), two_lamps(), SETTINGS, 12, 100)


def test_an_engine_equals_itself(truth, again):
    assert equivalence(truth, again, LOOSE).verdict == "equivalent"


def test_three_percent_of_brightness_are_found(truth, again):
    found = equivalence(truth, 1.03 * again, LOOSE)
    assert found.verdict == "different" and found.low < 0.03 < found.high


def test_a_shift_by_one_pixel_is_found_in_the_pixels(truth, again):
    assert image_tests(truth, np.roll(again, 1, axis=2), 0.01).pixel_p < 1e-6


def test_a_wrong_count_of_lights_is_found(truth, tmp_path):
    (fault,) = [fault for fault in FAULTS if fault.name == "light choice without its probability"]
    wrong = mutated(fault._replace(name="wrong count"), tmp_path)
    assert equivalence(truth, replicate_images(wrong, two_lamps(), SETTINGS, 12, 100), LOOSE).verdict == "different"


def test_the_command_compares_and_refuses_one_engine_alone():
    arguments = ["equivalence", "furnace", "--size", "16x16", "--spp", "4", "--replicates", "4", "--engines"]
    done = CliRunner().invoke(app, [*arguments, "numpy,numpy"])
    assert done.exit_code == 0 and "means at most" in done.output, done.output
    (row,) = [line for line in done.output.splitlines() if line.startswith("numpy  ")]
    assert "equivalent" in row or "unresolved" in row
    again = CliRunner().invoke(app, [*arguments, "numpy,numpy", "--same-seeds"])
    assert "numpy and numpy draw the same numbers, and their images are identical up to rounding in 100 %" in again.output
    assert "image means differ by at most 0 %, no tile by more than 0 %" in again.output
    refused = CliRunner().invoke(app, [*arguments, "numpy"])
    assert refused.exit_code != 0 and "--engine is expected, too" in str(refused.exception)
