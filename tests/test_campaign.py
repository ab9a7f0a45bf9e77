"""The campaign's short form, a few hundred inputs for each reader; long forms: ``python -m campaign.fuzz``."""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path
from random import Random

import pytest

from campaign import fuzz
from campaign.running import SLACK, Extent, Parser, campaign
from svv.errors import BadInput

SLOW = {"scenes": 40, "viewsets": 60, "classified": 60, "container": 150, "transforms": 200, "styles": 60, "masks": 60,
        "images": 60, "volumes": 60, "names": 30}  # fmt: skip


@pytest.mark.parametrize("name", [*fuzz.PARSERS, *fuzz.IN_C])
def test_every_reader_ends_normally_or_with_a_sentence(name: str) -> None:
    pytest.importorskip("vtkmodules")
    found = fuzz.attacked(name, Extent(1, SLOW.get(name, 300), 60.0))
    assert found["failures"] == {}
    assert found["inputs"] == SLOW.get(name, 300)


def broken(content: bytes) -> None:
    """A reader with one defect of each kind."""
    kind = content[0]
    if kind == 0:
        raise BadInput("It is damaged.")
    if kind == 1:
        raise KeyError("a")
    if kind == 2:
        bytearray(2 * SLACK)
    if kind == 3:
        raise BadInput(" ")


@pytest.mark.parametrize(
    ("kind", "failure"),
    [(0, None), (1, "KeyError in "), (2, "more memory than declared"), (3, "a sentence that says nothing"), (4, None)],
)
def test_the_campaign_finds_what_it_looks_for(tmp_path: Path, kind: int, failure: str | None) -> None:
    parser = Parser("broken", broken, lambda random: bytes([kind]))
    found = campaign(parser, Extent(0, 3, 10.0, tmp_path))
    assert [name[: len(failure or "")] for name in found.failures] == ([] if failure is None else [failure])
    assert found.rejected == 3 * (kind in (0, 3))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [bytes([kind])] * len(found.failures)


def test_the_same_seed_gives_the_same_inputs(tmp_path: Path) -> None:
    for name in ("tf", "container", "shots"):
        (tmp_path / name).mkdir()
        parser = fuzz.PARSERS[name](tmp_path / name)
        one, other = ([parser.make(random) for _ in range(50)] for random in (Random("1"), Random("1")))
        assert one == other


def test_the_command_adds_a_line_of_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["fuzz", "--parser", "series", "--inputs", "20", "--out", str(tmp_path)])
    assert fuzz.main() == 0
    line = json.loads((tmp_path / "figures.jsonl").read_text())
    assert (line["parser"], line["inputs"], line["failures"]) == ("series", 20, {})
