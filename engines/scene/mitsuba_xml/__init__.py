"""Scenes of Mitsuba, versions 0.4 to 3.x: XML files as scenes of raybench. MATERIALS sections 3 and 5 specify it."""

from engines.scene.mitsuba_xml.document import read_document
from engines.scene.mitsuba_xml.scene import import_scene

__all__ = ["import_scene", "read_document"]
