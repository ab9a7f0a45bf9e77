"""Settings that all tests share."""

from __future__ import annotations

from hypothesis import settings

# Machines differ in speed, and compiled kernels build on their first call: no test may fail for the time it takes.
settings.register_profile("svv", deadline=None)
settings.load_profile("svv")
