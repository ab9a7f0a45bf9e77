"""Pictures: style pictures and masks are read, rendered pictures and movies written.

Pictures with cameras are view sets: :mod:`svv.io.views`.
"""
