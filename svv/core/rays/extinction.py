"""Bounds of the extinction, which fields and volumes store as its natural logarithm.

Extinction is in 1 / box unit, so a ray keeps exp(-sigma) of its light over one box unit of extinction sigma.
"""

from __future__ import annotations

LEAST_LOG_EXTINCTION = -6.0
"""Lower bound of learned extinction. One box unit of it dims a ray by 1/400, less than an 8-bit step; below it a field
would hardly learn, because the gradient of an exponential is as small as the exponential itself."""

MOST_LOG_EXTINCTION = 9.0
"""Upper bound of learned and rendered extinction (a clipped exponential): e^9 is opaque within any step."""

EMPTY_LOG_EXTINCTION = -3.0
"""Value of empty points in a classified volume. Like :data:`OPAQUE_LOG_EXTINCTION` it lies inside the bounds of learned
extinction, so that training can move it either way and interpolation between both forms a surface."""

OPAQUE_LOG_EXTINCTION = 8.5
"""Value of opaque points in a classified volume."""
