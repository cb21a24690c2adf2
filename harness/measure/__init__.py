"""Measuring: worker processes, the pool that asks them, the clock, and what the machine did meanwhile."""
