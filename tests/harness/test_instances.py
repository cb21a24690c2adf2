"""What the harness makes of scenes with instances."""

import pytest

from engines import scene_from
from engines.errors import Unsupported
from harness.plan.planner import primitive_count
from harness.trace.rays import why_not
from harness.trace.truth import Truth

BALL = {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}
PAIR = {"spheres": {"centers": [[0, 0, 0], [1, 0, 0]], "radii": [1, 1]}, "material": "grey"}
SCENE = scene_from(
    {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
        "materials": {"grey": {"kd": 0.5}},
        "groups": {"three": [BALL, PAIR]},
        "shapes": [BALL, *[{"instance": {"group": "three", "matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}}] * 4],
    }
)


def test_an_instance_counts_as_the_primitives_of_its_group():
    assert primitive_count(SCENE) == 1 + 4 * 3


def test_races_of_rays_say_that_instances_have_no_exact_answers():
    assert why_not("camera", SCENE) == "rays have exact answers in scenes without instances"
    with pytest.raises(Unsupported, match="rays have exact answers in scenes without instances"):
        Truth(SCENE)
