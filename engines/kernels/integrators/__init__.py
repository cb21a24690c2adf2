"""Integrators (the format's word for them is `shader`): what one lane does at a vertex of its path, given its light
sample and the BSDF."""
