"""Shaders: the light-transport rules, one lane's step each, and the stage that runs them over a block."""
