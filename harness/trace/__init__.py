"""The rays-only league: sets of rays, exact answers to them, and what is wrong with an engine's.

`rays` makes the sets, `truth` answers them in decimals, `judge` compares an engine's answers with these, `records` are what
a results file holds.
"""
