"""Bounds of the extinction, as fields and volumes hold it: by its natural logarithm.

Extinction is in 1 / box unit, so a ray through a box of extinction sigma keeps exp(-sigma) of its light.
"""

from __future__ import annotations

LEAST_LOG_EXTINCTION = -6.0
"""Of what is learned: a box of it dims a ray by 1/400, less than a step of 8 bits, and below it a field would hardly
learn, for the gradient of an exponential is as small as the exponential."""

MOST_LOG_EXTINCTION = 9.0
"""Of what is learned, and of what is rendered (a clipped exponential): e^9 is opaque within any step."""

EMPTY_LOG_EXTINCTION = -3.0
"""Of what is empty in a classified volume. As :data:`OPAQUE_LOG_EXTINCTION` it lies within the bounds of what is
learned: from there on training can go either way, and what is interpolated between both is a surface."""

OPAQUE_LOG_EXTINCTION = 8.5
"""Of what is opaque in a classified volume."""
