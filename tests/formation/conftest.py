"""Kernels compile at their first call, which no example of a property test should be timed for."""

from hypothesis import settings

settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")
