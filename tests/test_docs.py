"""The documentation: examples run as they stand, links lead somewhere, reference pages are what the code says."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.bench.stability.scenes import EASY
from svv.dvr.views import make_views
from svv.train.config import PRESETS, ReconstructSettings, StylizeSettings

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "tutorials" / "python.md"

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=150, rays=1024, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=100, rays=1024),
    stylize=StylizeSettings(distil_iterations=20, distil_rays=1024, style_iterations=3, style_views=6, style_size=64),
)  # fmt: skip


PAGES = sorted([*DOCS.rglob("*.md"), DOCS.parent / "README.md", DOCS.parent / "CONTRIBUTING.md"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS.parent)))
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text()):
        if "://" in target:
            continue
        there = (page.parent / target).resolve() if target else page
        assert there.exists(), target
        if anchor and there.suffix == ".md":
            headings = re.findall(r"^#+ (.*)$", there.read_text(), re.MULTILINE)
            assert anchor in {_anchor(heading) for heading in headings}, f"{target}#{anchor}"


def _anchor(heading: str) -> str:
    """The name by which a heading is linked to, as MyST and GitHub have it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


def test_every_page_is_in_a_table_of_contents() -> None:
    named = {
        (index.parent / f"{entry}.md").resolve()
        for index in DOCS.rglob("index.md")
        for block in re.findall(r"```\{toctree\}\n(.*?)```", index.read_text(), re.DOTALL)
        for entry in re.findall(r"^([\w/-]+)$", block, re.MULTILINE)
    }
    assert named | {DOCS / "index.md"} == set(DOCS.rglob("*.md"))


@pytest.mark.parametrize("name", ["commands", "filters", "presets"])
def test_reference_pages_are_what_the_code_says(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run ``make docs`` after a change of a command, a filter or a setting."""
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(DOCS))
    made = importlib.import_module("generated")
    assert "\n".join(getattr(made, name)()) + "\n" == (DOCS / "reference" / f"{name}.md").read_text()


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "draft", SHORT)
    train, _ = make_views(EASY.volume(32), EASY.transfer_function(), 16, 64, mapper="cpu")
    train.write("views")
    for number, name in enumerate(("brush", "ink")):
        noise = np.random.default_rng(number).integers(0, 255, (64, 64, 3)).astype(np.uint8)
        Image.fromarray(noise).save(f"{name}.png")
    examples = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(examples) >= 4
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, str(PAGE), "exec"), names)
    said = capsys.readouterr().out
    assert "region 0: colour #cc1a1a, opacity 0.5" in said
    assert "('brush', 'ink') ink" in said
    assert "Region 0 is styled" in said
    assert {p.name for p in tmp_path.iterdir()} >= {"scene.svv", "red.png", "ink.svv"}
