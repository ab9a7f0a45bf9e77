"""What a training takes is in its report, what it does before and after its steps included."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from svv.io.views.agreement import check_agreement
from svv.io.views.equal_views import equal_views
from svv.job.compile_ahead import ball_views
from svv.train.base import tomography
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.recolour import Recolouring
from svv.train.pipeline import train_scene
from svv.train.run.config import preset


def test_seconds_hold_what_is_done_beside_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    late, clock = 0.0, time.monotonic

    def slowed(work: Callable[..., object]) -> Callable[..., object]:
        def slow(*args: object, **options: object) -> object:
            nonlocal late
            late += 1000.0
            return work(*args, **options)

        return slow

    monkeypatch.setattr(time, "monotonic", lambda: clock() + late)
    monkeypatch.setattr("svv.train.training.check_agreement", slowed(check_agreement))
    monkeypatch.setattr("svv.train.training.equal_views", slowed(equal_views))
    for kind, names in ((Reconstruction, ("__init__", "finish")), (Recolouring, ("__init__", "shares"))):
        for name in names:
            monkeypatch.setattr(kind, name, slowed(getattr(kind, name)))
    draft = preset("draft")
    few = replace(
        draft,
        lighting="network",
        reconstruct=replace(draft.reconstruct, iterations=20, cells=32),
        recolour=replace(draft.recolour, iterations=3),
    )
    _, report = train_scene(ball_views(), few)
    seconds = report["seconds"]
    assert all(seconds[stage] // 1000.0 == 2.0 for stage in ("check", "base", "pcn"))
    assert seconds["total"] // 1000.0 == late // 1000.0 == 6.0
    assert seconds.pop("total") == pytest.approx(sum(seconds.values()))


def test_opaque_pixels_of_views_are_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    views = ball_views()
    counted: list[tuple[int, ...]] = []

    def none_opaque(alpha: NDArray[np.uint8]) -> float:
        counted.append(alpha.shape)
        return 0.0

    assert tomography.mostly_opaque(replace(views, images=views.images.copy()))  # whose visible pixels all are
    monkeypatch.setattr(tomography, "opaque_part", none_opaque)
    assert not tomography.mostly_opaque(views) and not tomography.mostly_opaque(views)
    assert counted == [views.images.shape[:3]]
