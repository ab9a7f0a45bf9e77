"""The ``svv`` command: one module per group of commands, and what they share (options, tables); see ``app``."""
