"""Lights: how each kind is sampled from a point. One module a kind, with a function

    sample(light, p, normal, u0, u1) -> LightSample

of a `Light`, the point, the shading normal there and two random numbers. The radiance is that of the light alone:
whoever chose it among several divides by the probability of the choice.
"""
