"""File formats of volumes that are read box by box, whatever their size.

``svv.bricks.opened`` chooses one by the file.
"""
