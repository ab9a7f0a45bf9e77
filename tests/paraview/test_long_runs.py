"""A short form of the long runs in ParaView: operations leave nothing behind (campaign/paraview_long.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

from campaign.paraview_long import HOLDS, run, slope

MOST = {"malloc": 20_000, "resident": 200_000, "python": 60}
"""Bytes, bytes and blocks an operation. ParaView's own filters take 3,000 bytes (displays), and 20,000 resident ones in
the first hundreds; the histories of deleted panels took 117 blocks."""


@pytest.mark.slow
def test_operations_leave_nothing_behind(environ: dict[str, str], tmp_path: Path) -> None:
    samples = run("ours", {"operations": 60}, environ, tmp_path, samples=6)
    assert [one["done"] for one in samples] == [0, 10, 20, 30, 40, 50, 60]
    warm = samples[2:]
    for what in HOLDS:
        assert warm[-1][what] <= warm[0][what], (what, samples)
    grown = {what: slope(warm, what) for what in MOST}
    assert all(grown[what] < most for what, most in MOST.items()), grown


def test_the_slope_is_that_of_most_samples() -> None:
    samples = [{"done": n, "bytes": 7 * n + (10**6 if n == 4 else 0)} for n in range(12)]
    assert slope(samples, "bytes") == 7
