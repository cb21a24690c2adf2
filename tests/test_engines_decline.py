"""What an engine cannot render it declines in one line that names it; what it does not decline it prepares."""

import pytest

import engines
from engines import Settings, Unsupported

ENGINES = ("numpy", "numba", "embree", "embreex_batch", "mitsuba", "mitsuba_scalar", "dahlquist")
TRIANGLE = {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "grey"}
PARTS = {
    "disk": {"shapes": [TRIANGLE, {"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}, "material": "grey"}]},
    "spot": {"lights": [{"spot": {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 1}}]},
    "conductor": {"materials": {"grey": {"conductor": {"metal": "Au", "alpha": 0.2}}}},
}


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_declines_in_one_line_or_prepares(name, part):
    scene = engines.scene_from({
        "raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
        "materials": {"grey": {"kd": 0.5}}, "shapes": [TRIANGLE], **PARTS[part],
    })  # fmt: skip
    settings = Settings(4, 4, sampler="random")
    engine = engines.engine(name)
    reason = engine.why_not(scene, settings)
    if reason is None:
        assert engine.prepare(scene, settings).film.width == 4
        return
    assert reason and "\n" not in reason
    with pytest.raises(Unsupported) as refused:
        engine.prepare(scene, settings)
    assert str(refused.value) == reason
