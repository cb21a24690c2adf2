"""Shapes: each of `SHAPES` makes a shape of the scene from a plugin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.bsdf import Bsdf, Conductor, Dielectric, Mask, Blend, Bump, NormalMap, Principled, Sides
from engines.scene.mesh import Mesh
from engines.scene.mitsuba_xml import tessellate
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.tessellate import Triangles
from engines.scene.mitsuba_xml.transforms import Matrix, cofactors, mirrored, placed, similarity
from engines.scene.shapes import Cylinder, Disk, Shape, Sphere
from engines.scene.triple import Triple

UNTURNED = 1e-6
"""By how much a rotation may differ from none where texture coordinates depend on it."""
