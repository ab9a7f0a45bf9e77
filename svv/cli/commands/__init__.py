"""One module per group of commands: each reads its options and calls the layers below.

Options that several share are in :mod:`svv.cli.options`.
"""
