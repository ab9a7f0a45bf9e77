"""The hot functions of the renderer and its training, compiled for the processor; references stand in ``svv.core``."""
