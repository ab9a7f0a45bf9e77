"""Settings and scenes that tests share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from svv.fields.scene import Scene

# Machines differ in speed, and compiled kernels build on their first call: no test may fail for the time it takes.
settings.register_profile("svv", deadline=None)
settings.load_profile("svv")


@pytest.fixture(scope="session")
def cube() -> Scene:
    """A translucent cube, in which three regions lie about at random."""
    from tests.cube import cube_scene

    return cube_scene()


@pytest.fixture(scope="session")
def balls() -> Scene:
    """An orange and a blue ball side by side: two regions that do not mix."""
    from tests.balls import balls_scene

    return balls_scene()
