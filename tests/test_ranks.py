"""Steps of several processes are those of one, and they end like one; what the processes do is in ``ranked.py``."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.rounding import KERNELS, sums_apart
from svv.errors import BadInput, Cancelled, Elsewhere
from svv.fields.scene.scene import Scene
from svv.kernels import reference
from svv.kernels.numba import bfloat16
from svv.kernels.numba import kernels as numba_kernels
from svv.train.run import ranks
from tests import ranked
from tests.any_order import bounds, magnitudes
from tests.cube import cube_scene

ROOT = Path(__file__).resolve().parents[1]


def together(arguments: Sequence[object], count: int = 2) -> list[tuple[int, str, str]]:
    """Run the same command in several processes, as torchrun does; returns exit codes, output and errors."""
    command = [sys.executable, "-m", *map(str, arguments)]
    with socket.socket() as free:
        # Bound until the end, so that no other program is given this port; torch may still bind it to listen at it.
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        free.bind(("127.0.0.1", 0))
        shared = {
            **os.environ, "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(free.getsockname()[1]),
            "WORLD_SIZE": str(count), "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1",
        }  # fmt: skip
        started = [
            subprocess.Popen(
                command, env={**shared, "RANK": str(rank)}, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            for rank in range(count)
        ]
        said = [process.communicate() for process in started]
    return [(process.returncode, *its) for process, its in zip(started, said, strict=True)]


@pytest.fixture(scope="module", autouse=True)
def _single_precision() -> Iterator[None]:
    """As in the ranks, on every CPU."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bfloat16, "cpu_has_bfloat16", lambda: False)
        yield


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[tuple[int, str, str]]]:
    """Folder of what two ranks have learned, and how they ended: the second one was killed at last."""
    folder = tmp_path_factory.mktemp("two")
    ranked.alone(folder)
    for name in ("stopped", "died"):
        (folder / name).mkdir()
    return folder, together(["tests.ranked", folder])


def results(folder: Path, rank: int) -> dict[str, Any]:
    found = torch.load(folder / f"{rank}.pt", weights_only=True)
    assert isinstance(found, dict)
    return found


@pytest.mark.slow
def test_a_step_of_two_ranks_is_that_of_one(two: tuple[Path, list[tuple[int, str, str]]]) -> None:
    """The loss, gradients, moments and ages of Adam, parameters, numbers of rays, and what pruning goes by."""
    steps = sorted(two[0].glob("*.step"))
    assert len(steps) == 14
    for path in steps:
        right, found, (sums, count) = ranked.step_again(path), results(two[0], 0)[path.stem], magnitudes(path)
        apart = bounds(right, sums, count)
        apart["error"] = sums_apart(count) * right["error"]
        if "largest" in right:
            apart["largest"] = KERNELS["sigma"] * right["largest"]
        assert right.keys() == found.keys()
        off = {name: (found[name].double() - value.double()).abs() for name, value in right.items()}
        same = torch.zeros(())
        assert [name for name in off if not bool((off[name] <= apart.get(name, same)).all())] == [], path.stem
        free = [name for name, bound in apart.items() if bound.isinf().double().mean() > 0.5]
        assert free == [], f"{path.stem}: nothing is required of most values"


@pytest.mark.slow
def test_ranks_are_the_same_and_write_the_same(two: tuple[Path, list[tuple[int, str, str]]]) -> None:
    folder, _ = two
    first, second = (results(folder, rank) for rank in (0, 1))
    assert first.keys() == second.keys()
    for part in first:
        assert all(torch.equal(first[part][name], second[part][name]) for name in first[part]), part
    assert (folder / "0.svv").read_bytes() == (folder / "1.svv").read_bytes()


@pytest.mark.slow
def test_all_ranks_stop_when_one_is_stopped(two: tuple[Path, list[tuple[int, str, str]]]) -> None:
    assert all((two[0] / "stopped" / str(rank)).exists() for rank in (0, 1))


@pytest.mark.slow
def test_a_rank_that_dies_ends_the_run_which_another_number_of_ranks_resumes(
    two: tuple[Path, list[tuple[int, str, str]]],
) -> None:
    folder, ((first, _, said), (second, _, _)) = two
    assert (first, second) == (2, -signal.SIGKILL)
    assert said == f"svv: {ranks.LOST}\n"
    shown: list[str] = []
    scene = ranked.train(folder / "died", lambda fraction, label: shown.append(label))
    assert not any(label.startswith("base") for label in shown), "stage 1 was done"
    expected = results(folder, 0)["trained"]
    assert all(torch.equal(value, expected[name]) for name, value in scene.base.state_dict().items())
    camera = ranked.fog_views().cameras[0]
    whole = Scene.load(folder / "0.svv")  # in bytes, so the other must be, too
    np.testing.assert_allclose(
        Scene.from_bytes(scene.to_bytes()).render(camera).rgba, whole.render(camera).rgba, atol=2e-3
    )


@pytest.mark.slow
def test_the_first_rank_may_die_too(tmp_path: Path) -> None:
    """It has the store by which the ranks meet, and it writes the checkpoint."""
    (first, _, _), (second, _, said) = together(["tests.ranked", tmp_path, "first dies"])
    assert (first, second) == (-signal.SIGKILL, 2)
    assert said.splitlines()[-1] == f"svv: {ranks.LOST}", "torch may have said something before"
    shown: list[str] = []
    ranked.train(tmp_path, lambda fraction, label: shown.append(label))
    assert not any(label.startswith("base") for label in shown), "stage 1 was done"


@pytest.mark.slow
def test_ranks_share_views_and_databases(tmp_path: Path) -> None:
    """The files are those of one process, and none is drawn twice."""
    pytest.importorskip("vtkmodules")
    from tests.volume_files import write_function, write_volume

    write_volume(tmp_path / "ball.vti")
    write_function(tmp_path / "tf.json")
    cube_scene().save(tmp_path / "cube.svv")
    drawing = ["svv", "views", tmp_path / "ball.vti", "--tf", tmp_path / "tf.json", "--n", "4", "--test", "2"]
    drawing += ["--size", "24", "--mapper", "cpu", "--out"]
    export = ["svv", "export", tmp_path / "cube.svv", "--phi", "3", "--theta", "2", "--size", "16", "--out"]
    for number in (1, 2):
        for arguments, name in ((drawing, f"views{number}"), (export, f"{number}.cdb")):
            ended = together([*arguments, tmp_path / name], number)
            assert [code for code, _, _ in ended] == [0] * number, ended
            assert [out.count("\n") for _, out, _ in ended] == [1, *[0] * (number - 1)]
    for one, two in (("views1", "views2"), ("1.cdb", "2.cdb")):
        files = [path.relative_to(tmp_path / one) for path in (tmp_path / one).rglob("*") if path.is_file()]
        assert len(files) > 6
        for file in files:
            if not file.name.startswith("transforms"):  # has the seconds that drawing took
                assert (tmp_path / one / file).read_bytes() == (tmp_path / two / file).read_bytes(), file


def test_bad_input_is_said_once(tmp_path: Path) -> None:
    (first, _, said), (second, _, silent) = together(["svv", "train", tmp_path, "--out", tmp_path / "scene.svv"])
    assert (first, second) == (2, 2), silent
    assert said.startswith("svv: ") and said.count("\n") == 1
    assert silent == ""


@given(st.lists(st.integers(0, 1), max_size=40))
def test_marked_rows_are_those_of_the_reference(marks: list[int]) -> None:
    given_marks = torch.tensor(marks, dtype=torch.uint8)
    assert torch.equal(numba_kernels.marked_rows(given_marks), reference.marked_rows(given_marks))


def test_alone_nothing_is_shared() -> None:
    assert (ranks.many(), ranks.count(), ranks.is_first()) == (False, 1, True)
    assert ranks.part(7) == slice(0, 7)
    assert ranks.once(lambda: 3) == 3
    assert ranks.agreed(0.25, stop=False) == 0.25
    assert ranks.total(2.5) == 2.5
    numbers = torch.arange(3)
    assert ranks.summed(numbers) is numbers


@pytest.mark.parametrize("number", [0, 1, 5, 4096])
def test_parts_of_ranks_are_the_whole(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[int] = []
    for rank in range(3):
        monkeypatch.setattr(ranks, "_group", ranks._Group(ranks.Place(rank, 3), None))
        found += range(number)[ranks.part(number)]
    assert found == list(range(number))


@pytest.mark.parametrize(("rank", "count"), [("2", "2"), ("-1", "2"), ("one", "2")])
def test_numbers_that_no_launcher_gives(rank: str, count: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"RANK": rank, "WORLD_SIZE": count, "MASTER_ADDR": "localhost", "MASTER_PORT": "1"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(BadInput, match="torchrun"):
        ranks.place()


class Board:
    """A store as ranks share it, in one process."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def add(self, name: str, more: int) -> int:
        self.counts[name] = self.counts.get(name, 0) + more
        return self.counts[name]


def ended(rank: int, board: Board, error: Exception, monkeypatch: pytest.MonkeyPatch) -> Exception:
    """Return the error with which a rank ends if it meets one."""
    monkeypatch.setattr(ranks, "place", lambda: ranks.Place(rank, 2))
    monkeypatch.setattr(ranks, "_connected", lambda where, device: board)
    with pytest.raises(Exception) as raised, ranks.joined():  # noqa: PT011 (which one is the question)
        raise error
    assert not ranks.many()
    return raised.value


@pytest.mark.parametrize("first", [0, 1])
def test_one_rank_says_why_the_run_ends(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    board, wrong, lost = Board(), BadInput("It is full."), BadInput(ranks.LOST)
    assert ended(first, board, wrong, monkeypatch) is wrong
    other = ended(1 - first, board, lost, monkeypatch)
    assert isinstance(other, Elsewhere) and other.code == 2


@pytest.mark.parametrize("first", [0, 1])
def test_the_first_rank_says_that_the_run_was_stopped(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other one may notice only that a rank has gone."""
    board = Board()
    found = {first: ended(first, board, Cancelled(), monkeypatch)}
    found[1 - first] = ended(1 - first, board, BadInput(ranks.LOST), monkeypatch)
    assert isinstance(found[0], Cancelled)
    assert isinstance(found[1], Elsewhere) and found[1].code == 130


def test_the_signal_of_the_launcher_is_no_fault_of_the_file_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cube_scene().save(tmp_path / "cube.svv")
    monkeypatch.setattr("svv.fields.scene.scene_arrays.scene_of", lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    monkeypatch.setattr(ranks, "place", lambda: ranks.Place(0, 2))
    monkeypatch.setattr(ranks, "_connected", lambda where, device: Board())
    with pytest.raises(BadInput, match=r"^Another process of this run has ended"), ranks.joined():
        Scene.load(tmp_path / "cube.svv")
