"""Renderers of others as engines (mitsuba, luxcore, cycles, open3d, external), and what they share (adapters, export)."""
