"""Scenes of Mitsuba, versions 0.4 to 3.x: XML files as scenes of raybench. docs/guides/mitsuba_scenes.md says what is read."""

from engines.scene.mitsuba_xml.document import read_document
from engines.scene.mitsuba_xml.scene import import_scene

__all__ = ["import_scene", "read_document"]
