"""A scene as 3D Gaussian splats: where they start, how they are drawn with gradients, and how they are fitted."""
