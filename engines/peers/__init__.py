"""Renderers of others as engines, each an optional extra."""
