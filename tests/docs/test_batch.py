"""Who writes which field of a ray batch, as the table in the docs has it."""

from pathlib import Path

import pytest

from docs._ext import batch

SURFACE, LIGHT = {"hit_loads", "surface"}, {"light", "light_cells", "light_frames", "light_hierarchy", "resampling"}
RECORDS = {
    "hit": SURFACE | {"emission", "material"} | {"flight"},
    "found": SURFACE,
    "face": SURFACE,
    "light_sample": LIGHT | {"emission"},
    "light_face": LIGHT,
    "scatter": {"scattering", "guiding"},
    "branch": {"shade"},
    "wrapped": {"material"},
    "guide": {"guiding"},
    "recorded": {"guiding"},
    "flight": {"flight", "shade"},
    "attenuation": {"driver", "shade", "transmit"},
}
"""Records, and the modules of the stages that may write them."""


@pytest.fixture(scope="module")
def writers():
    """Field -> names of the modules that write it."""
    found = batch.writers()
    return {path: {Path(name).name for name in found[path]} for path in batch.paths()}


def test_every_field_is_written(writers):
    assert [path for path, by in writers.items() if not by] == []


def test_what_is_stored_part_by_part_or_through_a_parameter_counts(writers):
    assert writers["scatter.sample"] == {"scattering", "guiding"} and "queries" in writers["shadow.t_max"]


@pytest.mark.parametrize("record", RECORDS)
def test_a_record_is_written_by_its_stage_alone(record, writers):
    assert {name for path, by in writers.items() if path.startswith(f"{record}.") for name in by} <= RECORDS[record]


def test_the_light_stage_writes_nothing_that_the_hit_consists_of(writers):
    """So materials may be looked up before or after the light is sampled."""
    both = {path for path, by in writers.items() if by & LIGHT and by & (SURFACE | {"material"})}
    assert both <= {"draw"}  # both take up the rest of a random number of their own


def test_what_a_stage_keeps_for_itself_no_other_writes(writers):
    """All but the state of a path, which several stages move on, and what intersectors and the driver fill."""
    own = {path for path, by in writers.items() if len(by) == 1}
    rows = ("primitive_row", "shape_row", "formula_row", "emitter_row", "light_row", "light_primitive")
    for path in (*rows, "environment_place", "missed_place", "coordinates"):
        assert path in own
