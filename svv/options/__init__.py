"""The user's choices, one frozen dataclass per stage: the single source of all settings.

Each field has a type, a default and a sentence below it; :class:`svv.options.described.Setting` adds its range. The
options of the commands (:mod:`svv.cli.option_group`), the properties in ParaView (:mod:`svv.pv.panel.option_panel`) and
the tables of the documentation are derived from these. Nothing heavy is imported here: ParaView loads this package
before it opens its window.
"""
