"""Instances as rows: how groups are placed in the tracing coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.flatten.shapes import Geometry
from engines.kernels.rows import InstanceRow
from engines.scene import Instance

Reals = NDArray[np.float64]


def instance_rows(shapes: Any, geometry: Geometry, centers: list[Reals]) -> Reals:
    """(instances, numbers of a row). `centers` are the origins of the tracing coordinates, and of those of each group."""
    instances = geometry.instances
    rows = np.zeros((len(instances), InstanceRow.size))
    if not instances:
        return rows
    number = {id(group): place for place, group in enumerate(geometry.groups)}
    group = np.array([number[id(instance.group)] for instance in instances])
    matrix = np.array([instance.matrix for instance in instances])
    linear, moved = matrix[:, :, :3], matrix[:, :, 3]
    origin = np.array(centers[1:])[group]
    shown = np.array([isinstance(shape, Instance) for shape in shapes])
    own = np.cumsum(~shown)[shown]  # shapes before each instance that are none
    first = np.array([*geometry.first_id[: len(shapes) - len(instances)], geometry.begins[1].primitives])
    columns = {
        "out_x": linear.reshape(-1, 9),
        "in_x": np.linalg.inv(linear).reshape(-1, 9),
        "moved": np.einsum("nij,nj->ni", linear, origin) + moved - centers[0],
        "group": group[:, None],
        "shape": np.flatnonzero(shown)[:, None],
        "first": np.array([begin.primitives for begin in geometry.begins[1:]])[group, None],
        "behind": first[own, None],
    }
    for name, values in columns.items():
        begin = InstanceRow.fields[name].first
        rows[:, begin : begin + values.shape[1]] = values
    return rows
