"""Scenes that are functions of their volume's values, and their other time steps.

Other scenes hold what they learned on lattices: :mod:`svv.fields.radiance`.
"""
