"""Start of ParaView's programs with the plugin, and the environment of packages that they need.

``python3 -m svv.pv.launch pvpython script.py`` starts one from any Python.
"""
