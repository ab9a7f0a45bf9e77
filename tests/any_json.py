"""Hypothesis strategies for arbitrary JSON, such as a file may contain instead of the expected values."""

from __future__ import annotations

from hypothesis import strategies as st

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400)
any_json: st.SearchStrategy[object] = st.recursive(
    plain,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
"""Any JSON value; Python's parser also accepts NaN, infinities and integers of any length."""
