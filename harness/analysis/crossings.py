"""When errors reach the targets, and what a sample takes: DataFrames made of `points` and `cells`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.analysis.model import CONTESTANT_KEYS, PER_SAMPLE, Frame, measure_of
from harness.statistics import Bound, Crossing, Reading, crossing_seconds, curve, reading_of, time_to_quality
from harness.statistics.convergence import CLEAR_ERRORS, NOISE_ERRORS
from harness.store.records import BROKEN

Logs = NDArray[np.float64]
READINGS: tuple[Reading, Reading] = ("interpolated", "first")
CROSSINGS = [*CONTESTANT_KEYS, "block", "measure", "target", "reading", "own", "low", "high", "state", "noise", "fixed_seconds"]
SECONDS = ["seconds", "seconds_low", "seconds_high"]
TIMES = [*CONTESTANT_KEYS, "measure", "target", "start", *SECONDS, "reached", "at_first", "seeds", "reliable"]


def crossings(points: Frame, cells: Frame, targets: Mapping[float, float]) -> Frame:
    """One row a target, cell that had its chance, and way to read its error curve; and one a measured cell for its seconds per
    sample, of all its samples together.

    Columns: `scene` and `contestant`; `block`; `measure`; `target`, NaN of seconds per sample; `reading`, one of `READINGS`;
    `own`, whether the contestant's own curves are read so, see `statistics.reading_of`; `low`, `high`, `state` and `noise`, the
    `statistics.Crossing` in warm seconds; `fixed_seconds` of a cold start; `sure_low` and `sure_high`, bounds that allow for
    the noise of the reference.

    `points` and `cells` are those of `frames`. `targets`: goal -> the error that it stands for. Contestants without a measured
    cell are left out.
    """
    numbers = points[["spp", "seconds", "error", "error_se", "mean_spp"]].to_numpy(float)
    checkpoints = {cell_id: numbers[rows].T for cell_id, rows in points.groupby("cell_id").indices.items()}
    measured = (cells.state == "done") & cells.cell_id.isin(checkpoints.keys())
    of_measured = measured.groupby([cells[key] for key in CONTESTANT_KEYS]).transform("any")
    read = [*CONTESTANT_KEYS, "cell_id", "block", "state", "smooth_sampler", "reproducible", "fixed_seconds"]
    tried = cells.loc[(measured | cells.state.isin(BROKEN)) & of_measured, read]
    rows = []
    for who, found in tried.sort_values("block", kind="stable").groupby(CONTESTANT_KEYS, sort=False):
        each = [(cell, checkpoints.get(cell.cell_id, numbers[:0].T)) for cell in found.itertuples()]
        made = [curve(*of_curve, smooth=cell.smooth_sampler, reproducible=cell.reproducible) for cell, (*of_curve, _) in each]
        own = reading_of(made)
        for (cell, (_, taken, _, _, spp)), errors in zip(each, made, strict=True):
            if cell.state == "done" and taken[-1] > 0:
                seconds = taken[-1] / spp[-1]
                rows.append((*who, cell.block, PER_SAMPLE, math.nan, "", True, seconds, seconds, "reached", 0.0, 0.0))
            for target, error in targets.items():
                for reading in READINGS:
                    bound, state, noise = crossing_seconds(errors, error, reading)
                    rest = reading, reading == own, *bound, state, noise, cell.fixed_seconds
                    rows.append((*who, cell.block, measure_of(target), target, *rest))
    return _with_sure_bounds(pd.DataFrame(rows, columns=CROSSINGS))


def _with_sure_bounds(found: Frame) -> Frame:
    """Times that the reference's noise may have moved are known less well: by three of its standard errors, for times go as the
    inverse of the error at the most. Without an error that stands above its noise nothing is known."""
    found = found.astype({"own": bool, "noise": float})
    clear = (found.noise <= 1 / CLEAR_ERRORS) | ~found.own
    reliable = clear.groupby([found[key] for key in (*CONTESTANT_KEYS, "measure")]).transform("all").astype(bool)
    noise = found.noise.to_numpy(float)
    share = np.where(reliable, 0.0, np.where(noise < math.inf, NOISE_ERRORS * noise, math.inf))
    low = found.low * np.maximum(1 - share, 0.0)
    return found.assign(sure_low=low, sure_high=np.where(share < 1, found.high * (1 + share), math.inf))


def logs(times: Frame, count: int, low: str = "low", high: str = "high") -> tuple[Logs, Logs]:
    """(k, n) lower and upper ends of ln seconds of `count` contestants in one measure, from the columns `low` and `high`; NaN
    where one lacks a block. `row` of `times` is the place of a contestant."""
    blocks, columns = np.unique(times.block.to_numpy(int), return_inverse=True)
    ends = np.full((2, count, len(blocks)), math.nan)
    ends[:, times.row.to_numpy(int), columns] = times[[low, high]].to_numpy(float).T
    with np.errstate(divide="ignore"):
        least, most = np.log(ends)
    return least, most


def times_to_quality(crossings: Frame) -> Frame:
    """One row a start (warm, then cold), contestant and target: the columns of `TIMES`, from `seconds` on as in
    `statistics.QualityTime`."""
    own = crossings[crossings.own & (crossings.measure != PER_SAMPLE)]
    own = own.assign(crossing=list(map(Crossing, map(Bound, own.low, own.high), own.state, own.noise)))
    warm, cold = [], []
    for who, found in own.groupby([*CONTESTANT_KEYS, "measure", "target"], sort=False):
        each = found.crossing.tolist()
        warm.append((*who, "warm", *time_to_quality(each)))
        cold.append((*who, "cold", *time_to_quality(each, found.fixed_seconds)))
    return pd.DataFrame([*warm, *cold], columns=TIMES)
