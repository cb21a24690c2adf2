"""Comparison by rays: sets of rays, exact answers to them, and the errors of an engine's answers.

`rays` makes the sets, `truth` answers them, where float64 does not suffice in the decimals of `oracle`, `judge` compares an
engine's answers with these.
"""
