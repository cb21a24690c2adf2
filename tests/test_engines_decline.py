"""What an engine cannot render it declines in one line that names it; what it does not decline it prepares."""

from types import SimpleNamespace

import pytest

import engines
from engines import Settings, Unsupported
from engines.peers.export import export
from engines.scene import flattened
from tests.needs import needs

ENGINES = ("numpy", "numba", "embree", "embreex_batch", "mitsuba", "mitsuba_scalar", "dahlquist")
TRIANGLE = {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "grey"}
PARTS = {
    "disk": {"shapes": [TRIANGLE, {"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}, "material": "grey"}]},
    "spot": {"lights": [{"spot": {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 1}}]},
    "medium": {"media": {"fog": {"sigma_t": 1, "albedo": 0.5}}, "shapes": [{**TRIANGLE, "interior": "fog"}]},
    "instance": {
        "groups": {"g": [TRIANGLE]},
        "shapes": [{"instance": {"group": "g", "matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}}],
    },
    "conductor": {"materials": {"grey": {"conductor": {"metal": "Au", "alpha": 0.2}}}},
}


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_declines_in_one_line_or_prepares(name, part):
    assert _reason(engines.engine(name), _scene(PARTS[part])) != ""


def _scene(parts):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"grey": {"kd": 0.5}},
            "shapes": [TRIANGLE],
            **parts,
        }
    )


def _reason(engine, scene):
    """What an engine answers, one line, and `prepare` too; None where that works."""
    settings = Settings(4, 4, sampler="random")
    reason = engine.why_not(scene, settings)
    if reason is None:
        assert engine.prepare(scene, settings).film.width == 4
        return None
    assert "\n" not in reason
    with pytest.raises(Unsupported) as refused:
        engine.prepare(scene, settings)
    assert str(refused.value) == reason
    return reason


def test_engines_that_draw_no_instances_say_so(tmp_path):
    scene = _scene(PARTS["instance"])
    assert _reason(engines.engine("mitsuba"), scene) == "shapes[0]: Mitsuba does not support the shape Instance"
    for form, who in (("mitsuba", "Mitsuba"), ("pbrt", "pbrt")):
        with pytest.raises(Unsupported, match=rf"shapes\[0\]: {who} does not support the shape Instance"):
            export(scene, form, tmp_path)


@needs("mitsuba-scalar")
def test_mitsuba_renders_a_flattened_scene():
    assert _reason(engines.engine("mitsuba_scalar"), flattened(_scene(PARTS["instance"]))) is None


def _light(plugin):
    return {"lights": [{"plugin": {"type": plugin}}]}


def _bsdf(plugin):
    return {"materials": {"grey": {"plugin": {"type": plugin}}}}


def _plugin(numbers=1, **halves):
    return SimpleNamespace(name="own", options={f"x{k}": 0 for k in range(numbers)}, **halves)


def _function(*arguments):
    raise AssertionError("is not called before the engine says yes")


@pytest.mark.parametrize(("part", "what"), [(_light, "light"), (_bsdf, "BSDF")])
@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("numpy", "the {} 'own' has no NumPy function (`numpy`)"),
        ("embreex_batch", "the {} 'own' has no NumPy function (`numpy`)"),
        ("numba", "the {} 'own' has no `jitted` function, which the engine numba needs"),
        ("embree", "the {} 'own' has no `jitted` function, which the engine embree needs"),
    ],
)
def test_a_plugin_without_the_half_of_an_engine_is_declined(name, wanted, part, what):
    half = {"jitted": _function} if name in ("numpy", "embreex_batch") else {"numpy": _function}
    assert _reason(engines.engine(name), _scene(part(_plugin(**half)))) == wanted.format(what)


@pytest.mark.parametrize(("part", "what"), [(_light, "light"), (_bsdf, "BSDF")])
def test_other_renderers_have_no_plugins(part, what, tmp_path):
    scene = _scene(part(_plugin(jitted=_function, numpy=_function)))
    for name in ("mitsuba", "mitsuba_scalar"):
        assert f"Mitsuba does not support the {what} plugin 'own'" in str(_reason(engines.engine(name), scene))
    assert _reason(engines.engine("dahlquist"), scene) == "the engine dahlquist renders its own five balls alone"
    for form in ("mitsuba", "pbrt"):
        with pytest.raises(Unsupported, match=f"does not support the {what} plugin 'own'"):
            export(scene, form, tmp_path)


@pytest.mark.parametrize(("part", "most"), [(_light, 8), (_bsdf, 15)])
def test_more_options_than_lanes_have_room_for_are_declined(part, most):
    reason = _reason(engines.engine("numba"), _scene(part(_plugin(most + 1, jitted=_function))))
    assert reason == f"the options of 'own' are {most + 1} numbers, of which the engine numba takes {most}"
