"""`docs/how/where_renderers_differ.md`: what its table expects are closed forms, and every engine gives what the table says.

The scenes and shaders are those of `configs/disagreements.yaml`.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import engines
from engines import Settings
from harness import config
from tests.needs import marks_of

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/how/where_renderers_differ.md").read_text(encoding="utf-8")
COMBINATIONS = config.load(ROOT / "configs/disagreements.yaml").combinations
LARGEST_Z = 4.0
"""Standard errors by which means may differ: seeds are fixed."""
SQUARE = 4 / math.sqrt(5) * math.atan(1 / math.sqrt(5))
"""Irradiance below the centre of a square of radiance 1, at the distance of its side."""
SHADOW = 0.5 * (1 - 2**2 / (2**2 + 4**2))
TRUTHS = {
    "shadow scale=0.00001": SHADOW,
    "shadow offset=100000": SHADOW,
    "shadow apart=-100000, offset=100000": SHADOW,
    "mask": 0.25 * 0.5,
    "lamp": 0.5 / math.pi * SQUARE,
    "bumped_mask": 0.5 * (1 - 0.3),
    "slab z=1000": math.exp(-1),
    "clear_channel": 1.0,
}
"""Radiance of all pixels and channels by scene."""


def _table():
    """The radiance by scene and column of the table, as three numbers."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines() if line.startswith("|")]
    columns = next(row for row in rows if row[0] == "scene")
    found = {}
    for name, *cells in rows:
        if quoted := re.fullmatch("`(.+)`", name):
            values = [np.broadcast_to([float(word) for word in cell.split()], 3) for cell in cells]
            found[quoted[1]] = dict(zip(columns[1:], values, strict=True))
    return found


TABLE = _table()


def cases(ours):
    """The combinations of our engines or of Mitsuba's. Of numba only those in which precision counts: it shares all but the
    search for hits with embree, and compiles for seconds."""
    return [
        pytest.param(each, id=f"{each.scene.name}-{each.engine}-{each.precision}", marks=marks_of(each.engine))
        for each in COMBINATIONS
        if each.engine.startswith("mitsuba") is not ours and (each.engine != "numba" or each.scene.name.startswith("shadow"))
    ]


def check(case, column, sampler, spp):
    """The film, if the mean of each channel is the column's by the standard error of pixels."""
    scene, stated = case.scene.load(allow_imports=False), TABLE[case.scene.name][column]
    settings = Settings(shader=case.shader.describe(), sampler=sampler, seed=1, precision=case.precision)
    film = engines.engine(case.engine).prepare(scene, settings).render(spp)
    pixels = film.mean().reshape(-1, 3)
    error = pixels.std(axis=0, ddof=1) / math.sqrt(len(pixels))
    assert (error < 0.02 * stated).all(), f"standard errors {error} of {stated} find nothing"
    wrong = np.abs(pixels.mean(axis=0) - stated)
    assert (wrong <= LARGEST_Z * error + 5e-5).all(), f"{pixels.mean(axis=0)} +- {error}, not {stated}"
    return film


def test_the_table_has_every_scene_of_the_experiment_and_expects_closed_forms():
    assert [*TABLE] == [*dict.fromkeys(each.scene.name for each in COMBINATIONS)]
    assert {name: row["expected"].tolist() for name, row in TABLE.items()} == {
        name: [round(truth, 4)] * 3 for name, truth in TRUTHS.items()
    }


@pytest.mark.parametrize("case", cases(ours=True))
def test_our_engines_give_what_the_table_says(case):
    assert check(case, case.precision, "sobol", 16).bad_samples == 0


@pytest.mark.parametrize("case", cases(ours=False))
def test_mitsuba_gives_what_the_table_says(case):
    film = check(case, "Mitsuba", "random", 64)
    if case.scene.name == "clear_channel":
        scattered = 1 - (1 + math.exp(-1) + math.exp(-2)) / 3
        assert film.bad_samples / film.mean()[..., 0].size / 64 == pytest.approx(scattered, abs=0.02)
    else:
        assert film.bad_samples == 0
