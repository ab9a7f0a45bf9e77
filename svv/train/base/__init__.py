"""Stage 1: the base radiance field (:mod:`svv.fields.radiance`), from a first extinction to the finest level."""
