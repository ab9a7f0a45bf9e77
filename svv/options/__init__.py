"""What a user chooses, a frozen dataclass for each stage: the one source of settings.

A field has a type, a default and a sentence under it; :class:`svv.options.described.Setting` adds its range. From
these the command makes its options (:mod:`svv.cli.option_group`), ParaView its properties (:mod:`svv.pv.option_panel`)
and the documentation its tables. Nothing heavy is imported here: ParaView reads it before its window is there.
"""
