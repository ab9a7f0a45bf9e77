"""The ``svv`` command: one module per group of commands; each reads its options and calls the layers below."""
