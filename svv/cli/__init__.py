"""The ``svv`` command: one module a group of commands; each reads its options and calls what does the work."""
