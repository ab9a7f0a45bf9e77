"""Cases of one kind, of which some run every time and the others in ``make test-slow``."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def nightly(cases: Iterable[Any], *daily: Any) -> list[Any]:
    """Return cases for ``pytest.mark.parametrize``; all but the daily ones are marked slow."""
    listed = list(cases)
    unknown: Collection[Any] = [one for one in daily if one not in listed]
    assert daily and not unknown, f"no case is called {unknown}"
    return [
        case if case in daily else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
        for case in listed
    ]
