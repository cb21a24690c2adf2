"""Engines that are none."""


class NoEngine:
    """Has nothing that an engine has."""


class Exploding:
    def __init__(self):
        raise OSError("no such device")


class Nameless:
    """Has everything, until it is asked."""

    version = "1"

    @property
    def name(self):
        raise ValueError("the licence has expired")

    def why_not(self, scene, settings):
        return None

    def prepare(self, scene, settings):
        return None

    def accelerators(self):
        return {}


class Listless(Nameless):
    """Answers at first."""

    name = "broken_lists"

    def accelerators(self):
        raise KeyError("trees")
