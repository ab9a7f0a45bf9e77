"""Cinema databases: tables of images and the parameters with which they were drawn, read as view sets.

Read are Spec D (``data.csv``, as ParaView's image extractors and pycinema write it, with PNG or HDF5 images) and
Ascent's ``info.json``. :mod:`svv.render.cinema` writes scenes as Spec D.
"""
