"""What every test shares: hypothesis draws the same examples in every run, and sets no time limit on one."""

from hypothesis import settings

settings.register_profile("raybench", derandomize=True, deadline=None)
settings.load_profile("raybench")
