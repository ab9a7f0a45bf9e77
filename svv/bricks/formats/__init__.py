"""File formats of volumes that are read box by box, whatever their size, and the source of bricks that each is.

``svv.bricks.opened`` chooses one by the file.
"""
