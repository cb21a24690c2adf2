"""Functions of one lane, of values alone: no memory, nothing of the target that they are compiled for."""
