"""Numbers of inputs of the colour networks."""

DIRECTION_WIDTH = 16
"""Number of spherical harmonics of degree 4."""

FACING_WIDTH = 2
"""Number of inputs that tell how far a normal turns to a ray: the cosine's absolute value, and its square."""
