"""``svv bench profile``: its counts are right, its times add up, and it leaves the code that it watches unchanged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from svv.cli.app import app
from svv.dvr.draw.views import make_views
from svv.errors import BadInput, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import mlp
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import kernels_of
from svv_bench.profile.ceilings import Ceilings
from svv_bench.profile.profile import profile_views
from svv_bench.profile.table import STAGES, Profile, as_text, profile_of
from svv_bench.profile.watch import NETWORKS, Watch
from svv_bench.profile.work import Watched, Work, watched
from tests.stirred_volume import stirred_transfer_function, stirred_volume

CEILINGS = Ceilings(bytes=1e9, operations=1e10, half_operations=None, gathers=1e8, far_gathers=1e7)


@pytest.fixture(scope="module")
def views() -> ViewSet:
    return make_views(stirred_volume(24), stirred_transfer_function(), n=12, size=48, test=0, mapper="cpu")[0]


def test_the_floor_is_what_takes_longest() -> None:
    assert CEILINGS.floor(Work(1, 1e6, 1e6, 1e4)) == (1e-3, "bytes")
    assert CEILINGS.floor(Work(1, 1e3, 1e8, 1e4)) == (1e-2, "operations")
    assert CEILINGS.floor(Work(1, 1e3, 1e3, 1e7)) == (0.1, "reads")
    assert CEILINGS.floor(Work(products=1e8))[0] == pytest.approx(1e-2)
    fast = Ceilings(1e9, 1e10, 1e11, 1e8, 1e7)
    assert fast.floor(Work(products=1e8))[0] == pytest.approx(1e-3)


def test_work_of_an_encoding_is_what_it_touches() -> None:
    """One cell of one level, whatever the number of samples in it: eight rows come from memory."""
    lattice = SparseLattice(np.ones((4, 4, 4), np.uint8), 4, (4,), 2)
    x = torch.rand(100, 3, generator=torch.Generator().manual_seed(0)) * 0.24
    watch = Watch(watched(kernels_of("cpu")))
    with watch.on():
        work = watch.count(lambda: lattice.look_up(x), 3)["encode"]
    assert work.items == 100
    assert work.bytes == pytest.approx(100 * (12 + 4 * 2) + 8 * 4 * (1 + 2))
    assert work.gathers == pytest.approx(100 * 8)


def test_work_of_a_network_is_its_products() -> None:
    network, x = mlp(8, 16, 1, 3), torch.rand(50, 8, requires_grad=True)
    watch = Watch([])
    with watch.on():
        work = watch.count(lambda: network(x).sum().backward(), 2)
        with torch.no_grad():
            alone = watch.count(lambda: network(x), 1)
    assert work[NETWORKS].products == pytest.approx(2 * 50 * (8 * 16 + 16 * 3))
    assert work[f"{NETWORKS}, backward"].products == pytest.approx(2 * work[NETWORKS].products)
    assert set(alone) == {NETWORKS}


def test_every_moment_belongs_to_one_stage() -> None:
    """Stages within stages: to the inner one goes what it takes, to the outer one the rest."""

    class Owner:
        @staticmethod
        def inner() -> None:
            torch.ones(300, 300) @ torch.ones(300, 300)

        @staticmethod
        def outer() -> None:
            Owner.inner()

        @staticmethod
        def whole() -> None:
            Owner.inner()

    before = vars(Owner).copy()
    nothing = lambda arguments: Work()  # noqa: E731
    watch = Watch([Watched(Owner, "inner", "march", nothing), Watched(Owner, "outer", "encode", nothing),
                   Watched(Owner, "whole", "prune")])  # fmt: skip
    with watch.on():
        (nested,) = watch.time(Owner.outer, 1)
        (whole,) = watch.time(Owner.whole, 1)
    assert nested["march"] > 0 and nested["encode"] > 0
    assert "march" not in whole and whole["prune"] > 0
    assert all(callable(getattr(Owner, name)) and name in before for name in ("inner", "outer", "whole"))


def test_what_is_watched_is_left_as_it_was(views: ViewSet) -> None:
    functions = watched(kernels_of("cpu"))
    before = [getattr(one.owner, one.name) for one in functions]
    with pytest.raises(BadInput), Watch(functions).on():
        assert all(getattr(one.owner, one.name) is not was for one, was in zip(functions, before, strict=True))
        raise BadInput("stop")
    assert all(getattr(one.owner, one.name) is was for one, was in zip(functions, before, strict=True))


def test_stages_add_up_to_the_step() -> None:
    times = [{"march": 2e-3, "encode": 1e-3}, {"march": 4e-3, "encode": 1e-3}, {"march": 3e-3, "encode": 1e-3}]
    profile = profile_of("a step", 10, times, {"march": Work(5, 1e6)}, CEILINGS)
    assert profile.seconds == pytest.approx(4e-3)
    assert {s.name: round(s.share, 6) for s in profile.stages} == {"march": 0.75, "encode": 0.25}
    assert profile.floor == pytest.approx(1e-3)
    text = as_text([profile], CEILINGS)
    assert "a step: 10 rays, 4.00 ms, floor 1.00 ms" in text and "bytes" in text


@pytest.mark.slow
def test_a_profile_of_a_training(views: ViewSet) -> None:
    found = profile_views(views, "draft", 12, 2, 0, silent)
    first, second, palette, image = found["profiles"]
    for profile in (first, second):
        names = {s.name for s in profile.stages}
        assert names >= {"march", "encode", NETWORKS, f"{NETWORKS}, backward", "encode, backward", "Adam, tables"}
        assert names <= set(STAGES)
        assert sum(s.share for s in profile.stages) == pytest.approx(1.0)
        assert all(s.floor > 0 for s in profile.stages if s.name in ("march", "encode", "composite", NETWORKS))
    assert "regions of samples" in {s.name for s in palette.stages}
    assert "material and light" in {s.name for s in image.stages}
    assert not any("backward" in s.name or "Adam" in s.name for s in image.stages)


@pytest.mark.slow
def test_the_command(views: ViewSet, tmp_path: Path) -> None:
    views.write(tmp_path / "views", "train")
    options = ["--preset", "draft", "--steps", "8", "--timed", "1", "--json", str(tmp_path / "p.json")]
    said = CliRunner().invoke(app, ["bench", "profile", str(tmp_path / "views"), *options])
    assert said.exit_code == 0, said.output
    content = json.loads((tmp_path / "p.json").read_text())
    assert [p["name"] for p in content["profiles"]][-1].startswith("an image")
    assert content["ceilings"]["bytes"] > 0 and content["preset"] == "draft"


def test_too_few_steps_are_refused(views: ViewSet) -> None:
    with pytest.raises(BadInput, match="too few"):
        profile_views(views, "draft", 8, 15, 0, silent)


def test_json_is_plain() -> None:
    profile = profile_of("a step", 10, [{"march": 2e-3}], {"march": Work(5, 1e6)}, CEILINGS)
    assert isinstance(profile, Profile)
    assert json.loads(json.dumps(profile.to_json()))["stages"][0]["work"]["bytes"] == 1e6
